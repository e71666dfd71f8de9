//! Converts Rust errors to Python exceptions.

use base::document;
use base::locate::InputError as Fault;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::fmt::Display;

pyo3::create_exception!(
    pysunstone,
    InputError,
    PyValueError,
    "Invalid input. The attributes `file`, `line`, `column`, `message` and `fix` say where the problem is and how to fix it, or are None."
);
pyo3::create_exception!(
    pysunstone,
    RenderError,
    PyRuntimeError,
    "A render failed, for example because the disk is full. Finished work stays on disk and can be resumed."
);

/// Names of the attributes of Python's `InputError` in addition to its text.
const PARTS: [&str; 5] = ["file", "line", "column", "message", "fix"];

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = m.py();
    let input = py.get_type::<InputError>();
    for part in PARTS {
        input.setattr(part, py.None())?;
    }
    m.add("InputError", input)?;
    m.add("RenderError", py.get_type::<RenderError>())
}

/// Returns Python's `InputError` with a formatted message from the calling function.
macro_rules! bail {
    ($($message:tt)*) => {
        return Err($crate::error::input(format_args!($($message)*)))
    };
}
pub(crate) use bail;

/// Options of the command in messages, and what to write in Python.
const OPTIONS: [(&str, &str); 10] = [
    ("resume the render with `sunstone render --resume`", "render with `resume=True`"),
    ("`--resume`", "`resume=True`"),
    ("--resume", "resume=True"),
    ("`--force`", "`force=True`"),
    ("--force", "force=True"),
    ("another `-o`", "another output"),
    ("another -o", "another output"),
    ("(--prior)", "(argument `prior`)"),
    ("--variant", "the argument `variant`"),
    ("`--partial`", "`unfinished=True`"),
];

/// Replaces the options of the command in a message.
fn in_python(message: &str) -> String {
    OPTIONS.iter().fold(message.to_owned(), |text, (option, argument)| text.replace(option, argument))
}

/// Creates an error for invalid input that is not from a file.
pub fn input(e: impl Display) -> PyErr {
    InputError::new_err(in_python(&e.to_string()))
}

/// Creates an error for a failure at run time.
pub fn failed(e: impl Display) -> PyErr {
    RenderError::new_err(e.to_string())
}

/// Names of documents that exist only in memory. Their errors state the path of the key, because users do not
/// see the text.
const IN_MEMORY: [&str; 4] =
    ["scene in code", "materials in a dict", "media in a dict", "detector in a dict"];

/// Creates an error for invalid input with its location in a file or in a dict.
pub fn located(fault: Fault) -> PyErr {
    let what = IN_MEMORY.into_iter().find(|name| fault.file.ends_with(name));
    let fault = match what {
        Some(what) => document::in_code(what, fault),
        None => fault,
    };
    let error = input(&fault);
    let (line, column) = fault.line_column().unzip();
    let set = Python::attach(|py| {
        let value = error.value(py);
        value.setattr("file", fault.file.display().to_string())?;
        value.setattr("line", line)?;
        value.setattr("column", column)?;
        value.setattr("message", in_python(&fault.message))?;
        value.setattr("fix", fault.help.as_deref().map(in_python))
    });
    set.map_or_else(|e| e, |()| error)
}
