//! The `[projector]` table of a rig file, which contains limits, and the flash, LEDs and triggers of a
//! DLPC350.

use super::rig_syntax::{Driver, Led, ProjectorFile};
use super::{Fault, unsupported};
use crate::driver::dlpc350::flash;
use crate::driver::dlpc350::projector::Flash;
use crate::driver::dlpc350::trigger::Triggers;
use crate::instrument::ProjectorLimits;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Flash content, active LEDs and triggers of a DLPC350.
pub type FlashPlan = (Flash, u8, Triggers);

/// Checks the table of a rig file at `path`. Paths of flash images are relative to that file.
pub(super) fn check(path: &Path, p: &ProjectorFile) -> Result<(ProjectorLimits, Option<FlashPlan>), Fault> {
    if !p.size.iter().all(|n| (1..=65_536).contains(n)) {
        return Err(unsupported("size", p.size, "set size = [columns, rows], each from 1 to 65536"));
    }
    let (bits, shortest_ms) = (p.bits.unwrap_or(1), p.shortest_ms.unwrap_or(0.235));
    if !(1..=8).contains(&bits) {
        return Err(unsupported("bits", bits, "set 1 to 8 bits"));
    }
    let shortest = Duration::try_from_secs_f64(shortest_ms / 1e3).ok().filter(|_| shortest_ms < 1e6);
    let help = "set a number of milliseconds from 0 to less than 1e6";
    let shortest = shortest.ok_or_else(|| unsupported("shortest_ms", shortest_ms, help))?;
    let limits = ProjectorLimits { size: p.size, patterns: p.patterns.unwrap_or(4096), bits, shortest };
    if p.driver != Driver::Dlpc350 {
        if p.triggers != Triggers::default() || !p.flash.is_empty() {
            let what = "`flash` and `triggers` apply only to driver = \"dlpc350\"";
            return Err((what.to_owned(), "remove these keys, or set driver = \"dlpc350\""));
        }
        return Ok((limits, None));
    }
    let beside = |f: &PathBuf| path.parent().unwrap_or(Path::new("")).join(f);
    let files: Vec<PathBuf> = p.flash.iter().map(beside).collect();
    let help = "write the plan's patterns with `sunstone rig flash`, and list the images: flash = [\"flash_00.png\"]";
    let held = flash::load(&files).map_err(|e| (e, help))?;
    let triggers = p.triggers.commands();
    triggers.map_err(|e| (format!("triggers: {e}"), "correct `triggers`, or remove them"))?;
    let leds = p.leds.as_deref().unwrap_or(&[Led::Green]);
    let leds = leds.iter().fold(0, |all, led| all | *led as u8);
    Ok((limits, Some((held, leds, p.triggers))))
}

#[cfg(test)]
mod tests {
    use super::super::rig_file::from_toml;
    use std::path::Path;

    fn read(projector: &str) -> Result<super::super::rig_file::RigPlan, String> {
        let text = format!("[projector]\nsize = [912, 1140]\n{projector}");
        from_toml(Path::new("r.toml"), &text).map_err(|e| e.to_string())
    }

    #[test]
    fn triggers_are_read() {
        let text = "driver = \"dlpc350\"\ntriggers = { output_1 = { rise_us = -1 }, input = { edge = \"rising\" } }\n";
        let (_, leds, triggers) = read(text).expect("a rig").flash.expect("a flash");
        assert_eq!(leds, 2);
        assert!(triggers.input.is_some() && triggers.output_1.is_some_and(|o| o.rise_us == -1.0));
        for (projector, words) in [
            (
                "driver = \"dlpc350\"\ntriggers = { output_1 = { rise_us = -30 } }\n",
                "output_1.rise_us is -30",
            ),
            ("driver = \"dlpc350\"\ntriggers = { output_3 = {} }\n", "r.toml:4:14: unknown key `output_3`"),
            ("triggers = { input = { edge = \"rising\" } }\n", "apply only to driver"),
            ("driver = \"dlpc350\"\ntriggers = { input = { edge = \"up\" } }\n", "unknown name `up`"),
        ] {
            let message = read(projector).expect_err("a fault");
            assert!(message.contains(words), "{projector}: {message}");
        }
    }
}
