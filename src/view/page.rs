//! The files of the page.

use crate::answer::Answer;

/// Names, contents and media types of the files of the page.
pub(crate) const FILES: [(&str, &[u8], &str); 3] = [
    ("index.html", include_bytes!("built/index.html"), "text/html; charset=utf-8"),
    ("app.js", include_bytes!("built/app.js"), "text/javascript; charset=utf-8"),
    ("app.css", include_bytes!("built/app.css"), "text/css; charset=utf-8"),
];

/// Returns the file of a path of a URL, or `None` if the page has no such file.
pub(crate) fn file(path: &str) -> Option<Answer> {
    let name = if path == "/" { "index.html" } else { path.strip_prefix('/')? };
    let (_, bytes, kind) = FILES.iter().find(|(known, _, _)| *known == name)?;
    Some(Answer::File(bytes, kind))
}
