//! Parses IES LM-63 files of photometric type C. They contain measured intensity profiles of luminaires.
//!
//! Vertical angle 0 is the luminaire's downward axis. Horizontal angles rotate about the downward axis. The
//! vertical angles cover the lower hemisphere, the upper hemisphere or both. The range of the horizontal
//! angles, in degrees, depends on the luminaire's symmetry: 0 only, 0..90, 0..180, 90..270 or 0..360.

/// A luminaire's intensity profile, divided by the maximum of the profile.
#[derive(Clone, Debug, PartialEq)]
pub struct Ies {
    /// Vertical angles in degrees, increasing within 0..180.
    pub vertical: Vec<f32>,
    /// Horizontal angles in degrees, increasing from 0. The last angle is 0, 90, 180 or 360.
    pub horizontal: Vec<f32>,
    /// Relative intensities, 0..1: one row per horizontal angle, and one column per vertical angle.
    pub values: Vec<f32>,
}

/// Maximum number of angles per axis. Real photometric files have fewer angles.
const MOST: usize = 4096;

/// Parses an IES file.
///
/// # Errors
/// Returns a message with the line number if the file is invalid.
pub fn parse(bytes: &[u8]) -> Result<Ies, String> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = text.lines().enumerate();
    let tilt = lines.by_ref().find_map(|(i, line)| {
        let (key, value) = line.split_once('=')?;
        (key.trim() == "TILT").then(|| (i, value.trim().to_owned()))
    });
    let Some((at, tilt)) = tilt else {
        return Err("the line `TILT=` is missing, so the file is not an IES LM-63 file".into());
    };
    let mut numbers = Numbers {
        words: lines
            .flat_map(|(i, line)| {
                line.split([' ', '\t', ',', '\r']).filter(|w| !w.is_empty()).map(move |w| (i + 1, w))
            })
            .collect::<Vec<_>>()
            .into_iter(),
        last: at + 1,
    };
    match tilt.as_str() {
        "NONE" => {}
        "INCLUDE" => {
            numbers.next("the lamp position")?;
            let pairs = numbers.count("tilt angles")?;
            numbers.list(2 * pairs, "a tilt factor")?;
        }
        _ => {
            return Err(format!(
                "line {}: TILT={tilt} refers to another file, which is not supported; write TILT=NONE",
                at + 1
            ));
        }
    }
    for what in ["the number of lamps", "the lumens per lamp"] {
        numbers.next(what)?;
    }
    let multiplier = numbers.next("the multiplier")?;
    let (vertical, horizontal) = (numbers.count("vertical angles")?, numbers.count("horizontal angles")?);
    let kind = numbers.next("the photometric type")?;
    if kind != 1.0 {
        return Err(format!("line {}: expected photometric type 1 (C), got {kind}", numbers.last));
    }
    for what in
        ["units", "width", "length", "height", "the ballast factor", "a reserved number", "the input watts"]
    {
        numbers.next(what)?;
    }
    let vertical = numbers.angles(vertical, "a vertical angle", 180.0)?;
    let horizontal = numbers.angles(horizontal, "a horizontal angle", 360.0)?;
    let mut values = vec![];
    for _ in 0..horizontal.len() {
        values.extend(numbers.list(vertical.len(), "a candela value")?);
    }
    if let Some(bad) = values.iter().find(|v| **v < 0.0) {
        return Err(format!("a candela value is {bad}; expected 0 or more"));
    }
    let most = values.iter().fold(0.0_f32, |a, v| a.max(*v));
    if most <= 0.0 {
        return Err("the luminaire emits no light: all candela values are 0".into());
    }
    if multiplier <= 0.0 {
        return Err(format!(
            "the luminaire emits no light: the multiplier is {multiplier}, but must be above 0"
        ));
    }
    for v in &mut values {
        *v /= most;
    }
    whole(Ies { vertical, horizontal, values })
}

/// Extends a profile with horizontal angles 90°..270° to 0°..360°. Profiles with other valid ranges, which
/// start at 0°, are unchanged.
fn whole(ies: Ies) -> Result<Ies, String> {
    let (first, last) = (ies.horizontal[0], ies.horizontal[ies.horizontal.len() - 1]);
    if first == 0.0 && [0.0, 90.0, 180.0, 360.0].contains(&last) {
        return Ok(ies);
    }
    if (first, last) != (90.0, 270.0) {
        return Err(format!(
            "the horizontal angles cover {first} to {last} degrees; expected only 0, or 0..90, 0..180, 90..270 or 0..360 degrees"
        ));
    }
    // Mirror about the plane of 90 and 270 degrees.
    let row = |i: usize| ies.values[i * ies.vertical.len()..][..ies.vertical.len()].to_vec();
    let mut rows: Vec<(f32, Vec<f32>)> = vec![];
    for (i, angle) in ies.horizontal.iter().enumerate() {
        rows.push((*angle, row(i)));
        rows.push(((540.0 - angle) % 360.0, row(i)));
    }
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    rows.dedup_by(|a, b| a.0 == b.0);
    let (low, high) = (rows[0].clone(), rows[rows.len() - 1].1.clone());
    let joint: Vec<f32> =
        if low.0 == 0.0 { low.1 } else { low.1.iter().zip(&high).map(|(a, b)| 0.5 * (a + b)).collect() };
    if low.0 > 0.0 {
        rows.insert(0, (0.0, joint.clone()));
    }
    rows.push((360.0, joint));
    Ok(Ies {
        vertical: ies.vertical,
        horizontal: rows.iter().map(|r| r.0).collect(),
        values: rows.into_iter().flat_map(|r| r.1).collect(),
    })
}

/// The numbers of a file, with their line numbers.
struct Numbers<'a> {
    words: std::vec::IntoIter<(usize, &'a str)>,
    /// Line number of the last number read.
    last: usize,
}

impl Numbers<'_> {
    fn next(&mut self, what: &str) -> Result<f32, String> {
        let Some((line, word)) = self.words.next() else {
            return Err(format!("the file ends after line {}: expected {what}", self.last));
        };
        self.last = line;
        match word.parse::<f32>() {
            Ok(v) if v.is_finite() => Ok(v),
            _ => Err(format!("line {line}: expected {what}, got `{word}`")),
        }
    }

    fn count(&mut self, what: &str) -> Result<usize, String> {
        let n = self.next(&format!("the number of {what}"))?;
        if n.fract() == 0.0 && n >= 1.0 && n <= MOST as f32 {
            return Ok(n as usize);
        }
        Err(format!("line {}: the number of {what} is {n}; expected an integer from 1 to {MOST}", self.last))
    }

    fn list(&mut self, count: usize, what: &str) -> Result<Vec<f32>, String> {
        (0..count).map(|_| self.next(what)).collect()
    }

    /// Reads `count` increasing angles in degrees.
    fn angles(&mut self, count: usize, what: &str, most: f32) -> Result<Vec<f32>, String> {
        let list = self.list(count, what)?;
        let fits = |i: usize| (0.0..=most).contains(&list[i]) && (i == 0 || list[i - 1] < list[i]);
        let Some(i) = (0..count).find(|i| !fits(*i)) else {
            return Ok(list);
        };
        Err(format!(
            "line {}: {what} is {}, out of order or out of range; angles must increase within 0..{most} degrees",
            self.last, list[i]
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FILE: &str = "IESNA:LM-63-2002\n[TEST] none\nTILT=NONE\n1 1000 2.0 3 3 1 2 0 0 0\n1 1 50\n0 45 90\n90 180 270\n\
                        10 5 0\n8 4 0\n10 2 0\n";

    #[test]
    fn values_are_normalized_and_mirrored() {
        let ies = parse(FILE.as_bytes()).expect("reads");
        assert_eq!(ies.vertical, [0.0, 45.0, 90.0]);
        assert_eq!(ies.horizontal, [0.0, 90.0, 180.0, 270.0, 360.0]);
        let rows: Vec<&[f32]> = ies.values.chunks(3).collect();
        assert_eq!(rows[0], [0.8, 0.4, 0.0]);
        assert_eq!((rows[1], rows[3]), (&[1.0, 0.5, 0.0][..], &[1.0, 0.2, 0.0][..]));
        assert_eq!((rows[0], rows[4]), (rows[2], rows[2]));
        let tilted = FILE.replace("TILT=NONE", "TILT=INCLUDE\n1\n2\n0 90\n1 0.5");
        assert_eq!(parse(tilted.as_bytes()), Ok(ies));
    }

    #[test]
    fn errors_name_the_line() {
        let cases = [
            ("", "", "TILT"),
            ("TILT=NONE", "TILT=lamp.tlt", "line 3: TILT=lamp.tlt"),
            ("1 1000", "1 x", "line 4: expected the lumens per lamp, got `x`"),
            ("3 3 1 2", "3 3 2 2", "line 4: expected photometric type 1 (C), got 2"),
            ("3 3 1 2", "3 0 1 2", "line 4: the number of horizontal angles is 0; expected an integer"),
            ("0 45 90", "0 95 90", "line 6: a vertical angle is 90, out of order"),
            ("90 180 270", "90 180 280", "cover 90 to 280"),
            ("10 2 0\n", "10 2", "the file ends after line 10"),
            ("10 5 0", "10 -5 0", "a candela value is -5"),
            ("10 5 0\n8 4 0\n10 2 0", "0 0 0 0 0 0 0 0 0", "emits no light"),
        ];
        for (a, b, expected) in cases {
            let text = if a.is_empty() { String::new() } else { FILE.replace(a, b) };
            let error = parse(text.as_bytes()).expect_err(expected);
            assert!(error.contains(expected), "{error}, not {expected}");
        }
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = parse(&bytes);
        }

        #[test]
        fn edited_files_never_panic(at in 30usize..100, with in "[0-9 .\\-eE\n]{0,6}") {
            let at = at.min(FILE.len());
            let _ = parse(format!("{}{with}{}", &FILE[..at], &FILE[at..]).as_bytes());
        }
    }
}
