//! Tests that the parser accepts valid plans, rejects invalid plans, and does not panic on any text.

use super::*;
use proptest::prelude::*;

const GOOD: &str = "scheme = { kind = \"drr\", captures = 36 }\n[camera]\nexposures_ms = [20, 80]\n\
                    masks = [\"full\", { name = \"epipolar\", stripes = 8 }]\n";

fn read(text: &str) -> Result<Plan, String> {
    from_toml(Path::new("p.toml"), text).map_err(|e| e.to_string())
}

#[test]
fn a_plan_is_read() {
    let plan = read(GOOD).expect("a plan");
    assert_eq!(plan.run_shape(), [36, 9, 2]);
    assert_eq!(plan.frames(), 648);
    assert_eq!(plan.limits, Limits::default());
    let scan = "scheme = { kind = \"drr\", captures = 4 }\n[scan]\npoints = [5, 3]\nfov_x_deg = 20\ndwell_ms = 42\n\
                bins = 100\nbin_ps = 25\n[limits]\nretries = 2\n";
    assert_eq!(read(scan).expect("a plan").run_shape(), [4, 3, 5]);
}

#[test]
fn errors_name_position_and_fix() {
    let cases = [
        ("\"full\"", "\"ful\"", "unknown mask `ful`"),
        ("stripes = 8", "stripes = 0", "`stripes` is 0"),
        ("\"epipolar\"", "\"full\"", "duplicate mask `full`"),
        ("[20, 80]", "[20, -1]", "`exposures_ms` contains -1"),
        ("[20, 80]", "[]", "`exposures_ms` has 0 entries"),
        ("\"drr\"", "\"drrr\"", "unknown scheme `drrr`"),
        ("captures = 36", "captures = 0", "0 captures"),
        ("[camera]", "[cam]", "unknown key `cam`"),
        ("stripes = 8", "stripes = 8, outsid = true", "did not match"),
    ];
    for (old, new, want) in cases {
        let message = read(&GOOD.replacen(old, new, 1)).expect_err("a fault");
        assert!(message.contains(want) && message.contains("fix"), "{new}: {message}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10_000))]
    /// The parser rejects or parses damaged plans, without a panic.
    #[test]
    fn damaged_plans_never_panic(at in any::<prop::sample::Index>(), with in ".{0,6}", cut in 0..8_usize) {
        let at = at.index(GOOD.len());
        if GOOD.is_char_boundary(at) {
            let end = (at + cut).min(GOOD.len());
            let text = format!("{}{with}{}", &GOOD[..at], &GOOD[end..]);
            let _ = read(&text);
        }
    }
}
