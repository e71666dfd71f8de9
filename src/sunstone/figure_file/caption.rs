//! Parses captions and inserts values into them, as in `{method}: {peak signal-to-noise ratio:.1} dB`.

use super::source::Fault;

/// A value for captions.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    Text(String),
    Number(f64),
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Piece {
    Text(String),
    /// The name of a value, and the number of decimals.
    Value(String, Option<usize>),
}

/// Splits a caption at its braces. Doubled braces are literal.
fn pieces(caption: &str) -> Result<Vec<Piece>, Fault> {
    let help = "write {name} or {name:.2} for a value, and {{ and }} for braces";
    let fault = |message: &str| (message.to_owned(), help.to_owned());
    let (mut out, mut text) = (vec![], String::new());
    let mut chars = caption.chars().peekable();
    while let Some(c) = chars.next() {
        match c {
            '{' | '}' if chars.peek() == Some(&c) => {
                chars.next();
                text.push(c);
            }
            '}' => return Err(fault("} without {")),
            '{' => {
                let mut inside = String::new();
                loop {
                    match chars.next() {
                        Some('}') => break,
                        Some(c) if c != '{' => inside.push(c),
                        _ => return Err(fault("{ without }")),
                    }
                }
                let (name, digits) = match inside.rsplit_once(":.") {
                    None => (inside.as_str(), None),
                    Some((name, digits)) => match digits.parse() {
                        Ok(n) if n <= 12_usize => (name, Some(n)),
                        _ => {
                            let message = format!("the number of digits must be 0 to 12, got `{digits}`");
                            return Err(fault(&message));
                        }
                    },
                };
                out.push(Piece::Text(std::mem::take(&mut text)));
                out.push(Piece::Value(name.trim().to_owned(), digits));
            }
            c => text.push(c),
        }
    }
    out.push(Piece::Text(text));
    Ok(out)
}

/// Checks the syntax of a caption.
///
/// # Errors
/// Returns [`Fault`] if the braces are invalid.
pub fn check(caption: &str) -> Result<(), Fault> {
    pieces(caption).map(|_| ())
}

/// Inserts values into a caption.
///
/// # Errors
/// Returns [`Fault`] if the caption names a value that is not in `known`.
pub fn fill(caption: &str, known: &[(String, Value)]) -> Result<String, Fault> {
    let mut out = String::new();
    for piece in pieces(caption)? {
        match piece {
            Piece::Text(text) => out += &text,
            Piece::Value(name, digits) => {
                let Some((_, value)) = known.iter().find(|(n, _)| *n == name) else {
                    let names: Vec<&str> = known.iter().map(|(n, _)| n.as_str()).collect();
                    return Err((
                        format!("the caption uses a value `{name}` that this panel does not have"),
                        format!("use one of: {}", names.join(", ")),
                    ));
                };
                match (value, digits) {
                    (Value::Text(text), _) => out += text,
                    (Value::Number(v), _) if !v.is_finite() => out.push('–'),
                    (Value::Number(v), Some(n)) => out += &format!("{v:.n$}").replace('-', "−"),
                    (Value::Number(v), None) => out += &format!("{v}").replace('-', "−"),
                }
            }
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn placeholders_are_replaced_by_values() {
        let known = [
            ("method".to_owned(), Value::Text("ours".into())),
            ("area under the curve".to_owned(), Value::Number(0.987_6)),
            ("nothing".to_owned(), Value::Number(f64::NAN)),
        ];
        let say = |text: &str| fill(text, &known);
        assert_eq!(say("{method}: {area under the curve:.2} {{x}}"), Ok("ours: 0.99 {x}".into()));
        assert_eq!(say("{nothing:.1} plain"), Ok("– plain".into()));
        for bad in ["{metod}", "{method", "method}", "{method:.x}", "{{method}", "{a{b}}"] {
            assert!(say(bad).is_err(), "{bad}");
        }
        assert!(say("{metod}").is_err_and(|(_, help)| help.contains("area under the curve")));
    }

    proptest! {
        /// Tests that no text causes a panic, and that a text without braces is not changed.
        #[test]
        fn arbitrary_text_never_panics(text in "\\PC{0,40}", braces in "[{}:.a0-9]{0,20}") {
            let _ = fill(&braces, &[]);
            let plain = text.replace(['{', '}'], "");
            prop_assert_eq!(fill(&plain, &[]), Ok(plain));
        }
    }
}
