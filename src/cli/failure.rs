//! Defines the failures of commands. Each failure has one message and one exit code.

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
use std::fmt;
use std::io::IsTerminal;
use std::path::Path;
use sunstone::base::locate::InputError;
use sunstone::scene::mitsuba::import::ImportError;

/// Returns [`Failure::Input`] with a formatted message from the calling function.
macro_rules! bail {
    ($($message:tt)*) => {
        return Err($crate::Failure::input(format_args!($($message)*)))
    };
}
pub(crate) use bail;

/// The reason why a command failed.
pub enum Failure {
    /// Errors in a file, with locations. The exit code is 2.
    File(Vec<InputError>),
    /// Other invalid input. The exit code is 2.
    Input(String),
    /// A failure during the run, such as a full disk. The exit code is 1.
    Failed(String),
    /// An interruption by the user. The exit code is 130.
    Interrupted(String),
}

impl Failure {
    pub fn input(e: impl fmt::Display) -> Self {
        Self::Input(e.to_string())
    }

    pub fn failed(e: impl fmt::Display) -> Self {
        Self::Failed(e.to_string())
    }

    /// Returns a function that converts an error of reading or writing the file at `path`.
    pub fn at<E: fmt::Display>(path: &Path) -> impl Fn(E) -> Self {
        move |e| Self::failed(format_args!("{}: {e}", path.display()))
    }

    /// Returns a function that converts an error of writing the file at `path`.
    pub fn writing<E: fmt::Display>(path: &Path) -> impl Fn(E) -> Self {
        move |e| Self::failed(format_args!("cannot write {}: {e}", path.display()))
    }

    /// Returns [`Failure::Failed`] if `is_of_system` is true, otherwise [`Failure::Input`].
    pub fn of_system(is_of_system: bool, e: impl fmt::Display) -> Self {
        if is_of_system { Self::failed(e) } else { Self::input(e) }
    }

    /// Prints the message to standard error and returns the exit code.
    pub fn report(&self) -> u8 {
        match self {
            Self::File(errors) => {
                errors.iter().take(MOST).for_each(report_error);
                if errors.len() > 1 {
                    eprintln!("{} problems", errors.len());
                }
                2
            }
            Self::Input(m) => {
                eprintln!("{}", cut(&format!("error: {m}")));
                2
            }
            Self::Failed(m) => {
                eprintln!("{}", cut(&format!("error: {m}")));
                1
            }
            Self::Interrupted(m) => {
                eprintln!("{m}");
                130
            }
        }
    }
}

impl From<ImportError> for Failure {
    fn from(e: ImportError) -> Self {
        Self::File(e.0)
    }
}

impl From<InputError> for Failure {
    fn from(e: InputError) -> Self {
        Self::File(vec![e])
    }
}

/// Maximum number of printed characters per line.
const LONGEST: usize = 2000;
/// Maximum number of printed errors per file.
const MOST: usize = 50;

/// Truncates long lines, and texts with many lines.
fn cut(text: &str) -> String {
    let short = |line: &str| match line.char_indices().nth(LONGEST) {
        Some((at, _)) => format!("{} … ({} more bytes)", &line[..at], line.len() - at),
        None => line.to_owned(),
    };
    let lines: Vec<String> = text.lines().take(MOST + 1).map(short).collect();
    match text.lines().count().checked_sub(MOST) {
        Some(more) if more > 1 => format!("{}\n… and {more} more lines", lines[..MOST].join("\n")),
        _ => lines.join("\n"),
    }
}

/// Prints `file:line:column: message`, which editors and scripts parse, and then the location in the file.
fn report_error(e: &InputError) {
    eprintln!("{}", cut(&format!("error: {e}")));
    let Some(span) = e.span.clone().filter(|_| !e.text.is_empty()) else {
        return;
    };
    // If a span has several lines, such as a whole table, only its first line is marked.
    let text = &e.text[span.start.min(e.text.len())..span.end.min(e.text.len())];
    let length = text.find('\n').unwrap_or(text.len());
    // Source lines with more than LONGEST characters in total are not printed.
    let start = span.start.min(e.text.len());
    let around = e.text[..start].rsplit('\n').take(2).map(str::len).sum::<usize>()
        + e.text[start..].split('\n').take(2).map(str::len).sum::<usize>();
    if around > LONGEST {
        return;
    }
    // The message is already printed, so only the location is printed.
    let here = AnnotationKind::Primary.span(start..start + length).label("here");
    let place = Snippet::source(&*e.text).annotation(here);
    let is_plain = !std::io::stderr().is_terminal() || std::env::var_os("NO_COLOR").is_some();
    let renderer = if is_plain { Renderer::plain() } else { Renderer::styled() };
    eprintln!("{}", renderer.render(&[Group::with_level(Level::ERROR).element(place)]));
}
