//! How commands fail: one clear message, one exit code.

use miette::{Diagnostic, GraphicalReportHandler, LabeledSpan, NamedSource, SourceCode};
use std::fmt;
use sunstone::base::locate::InputError;
use sunstone::scene::mitsuba::import::ImportError;

/// Why a command did not succeed.
pub enum Failure {
    /// A scene file is wrong: exit code 2.
    Scene(InputError),
    /// Several things in it are: exit code 2.
    Scenes(Vec<InputError>),
    /// Other bad input: exit code 2.
    Input(String),
    /// Something failed on the way (disk full, …): exit code 1.
    Failed(String),
    /// Stopped by the user: exit code 130.
    Interrupted(String),
}

impl Failure {
    /// Bad input.
    pub fn input(e: impl fmt::Display) -> Self {
        Self::Input(e.to_string())
    }

    /// Failure on the way.
    pub fn failed(e: impl fmt::Display) -> Self {
        Self::Failed(e.to_string())
    }

    /// Failure on the way if the system refused, else bad input.
    pub fn of_system(is_of_system: bool, e: impl fmt::Display) -> Self {
        if is_of_system {
            Self::failed(e)
        } else {
            Self::input(e)
        }
    }

    /// Tells the user, and gives the exit code.
    pub fn report(&self) -> u8 {
        match self {
            Self::Scene(e) => {
                report_scene(e);
                2
            }
            Self::Scenes(errors) => {
                errors.iter().take(MOST).for_each(report_scene);
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
        Self::Scenes(e.0)
    }
}

impl From<InputError> for Failure {
    fn from(e: InputError) -> Self {
        Self::Scene(e)
    }
}

/// A scene error as miette shows it.
#[derive(Debug)]
struct Shown {
    message: String,
    help: Option<String>,
    source: NamedSource<String>,
    label: LabeledSpan,
}

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Shown {}

impl Diagnostic for Shown {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.help.as_ref().map(|h| Box::new(h) as _)
    }
    fn source_code(&self) -> Option<&dyn SourceCode> {
        Some(&self.source)
    }
    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        Some(Box::new(std::iter::once(self.label.clone())))
    }
}

/// Most characters of a line that are shown.
const LONGEST: usize = 2000;
/// Most problems of a file that are shown.
const MOST: usize = 50;

/// A text whose long lines are cut, and that has few lines.
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

/// First the line that editors and scripts read, `file:line:column: message`, then the place in the file.
fn report_scene(e: &InputError) {
    eprintln!("{}", cut(&format!("error: {e}")));
    let Some(span) = e.span.clone().filter(|_| !e.text.is_empty()) else {
        return;
    };
    // A span over many lines (a whole table) is shown by its first line.
    let text = &e.text[span.start.min(e.text.len())..span.end.min(e.text.len())];
    let length = text.find('\n').unwrap_or(text.len());
    // A line that no screen holds says nothing.
    let start = span.start.min(e.text.len());
    let around = e.text[..start].rsplit('\n').take(2).map(str::len).sum::<usize>()
        + e.text[start..].split('\n').take(2).map(str::len).sum::<usize>();
    if around > LONGEST {
        return;
    }
    let shown = Shown {
        message: e
            .message
            .lines()
            .next()
            .unwrap_or_default()
            .chars()
            .take(LONGEST)
            .collect(),
        help: None,
        source: NamedSource::new(e.file.display().to_string(), e.text.to_string()),
        label: LabeledSpan::new(Some("here".into()), span.start, length),
    };
    let mut out = String::new();
    if GraphicalReportHandler::new()
        .render_report(&mut out, &shown)
        .is_ok()
    {
        // The message has been printed; keep the picture of the place only.
        let picture: Vec<&str> = out.lines().skip_while(|l| !l.contains('[')).collect();
        eprintln!("{}", picture.join("\n"));
    }
}
