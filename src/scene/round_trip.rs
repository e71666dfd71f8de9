//! Tests that shipped scenes and random scenes of the JSON schema are equal after writing and reading.

use proptest::prelude::*;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};
use syntax::scene::SceneFile;
use transport::scene::Scene;

fn scenes(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            scenes(&path, found);
        } else if path.extension().is_some_and(|e| e == "toml") {
            let text = std::fs::read_to_string(&path).expect("a text");
            if text.lines().any(|line| line.trim() == "[camera]") {
                found.push(path);
            }
        }
    }
}

fn tables(s: &Scene) -> String {
    let materials = (&s.materials.list, &s.materials.textures.images, &s.boundaries);
    let light = (&s.points, &s.environment, &s.lights);
    let devices = (&s.wavelengths, &s.camera, &s.projector, light);
    let copies: Vec<_> = s.geometry.instances().collect();
    let rest = (&s.name, &s.settings, s.geometry.counts(), copies);
    format!("{materials:?} {devices:?} {rest:?} {:?} {:?}", s.media, s.slices)
}

#[test]
#[ignore = "slow: tools/check --all"]
fn shipped_scenes_round_trip() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut paths = vec![];
    for folder in ["scenes", "validation"] {
        scenes(&root.join(folder), &mut paths);
    }
    assert!(paths.len() >= 20, "{paths:?}");
    let mut built = 0;
    for path in &paths {
        let text = std::fs::read_to_string(path).expect("a text");
        let first: SceneFile = toml::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let written = first.to_toml().expect("a text");
        let second: SceneFile = toml::from_str(&written).unwrap_or_else(|e| panic!("{e}\n{written}"));
        assert_eq!(first, second, "{written}");
        assert_eq!(written, second.to_toml().expect("a text"));
        // Scenes that need generated files cannot be built in this test.
        if let Ok(a) = crate::from_text(path, &text) {
            let b = crate::from_text(path, &written).unwrap_or_else(|e| panic!("{e}\n{written}"));
            assert_eq!(tables(&a), tables(&b), "{}", path.display());
            built += 1;
        }
    }
    assert!(built >= 14, "{built} of {}", paths.len());
}

#[test]
fn defaults_are_not_written() {
    let text = "[camera]\nresolution = [2, 3]\nfov_x_deg = 40.0\n\n[camera.pose.look_at]\norigin = [0.0, 0.0, 4.0]\ntarget = [0.0, 0.0, 0.0]\n";
    let scene: SceneFile = toml::from_str(text).expect("a scene");
    assert_eq!(scene.to_toml().expect("a text"), text);
}

/// A source of random choices. The choices are determined by numbers that proptest can shrink. When no
/// numbers remain, each choice is the simplest.
struct Choices<'a> {
    words: std::slice::Iter<'a, u64>,
    /// Schemas to which `$ref` refers, by name.
    definitions: &'a Value,
}

impl Choices<'_> {
    fn word(&mut self) -> u64 {
        self.words.next().copied().unwrap_or(0)
    }

    fn below(&mut self, n: u64) -> u64 {
        self.word() % n
    }

    fn any_of<'v>(&mut self, list: &'v [Value]) -> &'v Value {
        &list[self.below(list.len() as u64) as usize]
    }

    fn number(&mut self) -> f64 {
        match self.below(6) {
            0 => 0.0,
            1 => 1.0,
            2 => -0.5,
            3 => self.below(1000) as f64,
            4 => 1.0 / (1 + self.below(1000)) as f64,
            _ => Some(f64::from_bits(self.word())).filter(|v| v.is_finite()).unwrap_or(1e300),
        }
    }

    fn text(&mut self) -> String {
        const WORDS: [&str; 10] = ["a", "gold", "", "two words", "a.b", "\"", "\n\\", "ü €", "[x]", "true"];
        WORDS[self.below(10) as usize].to_owned() + &self.below(3).to_string()
    }

    /// Returns a random value that a schema describes, or null for an absent value. Numbers ignore
    /// the limits in the schema, because limits are checked only when a scene is built.
    fn value(&mut self, schema: &Value) -> Value {
        if let Some(path) = schema["$ref"].as_str() {
            let name = path.strip_prefix("#/$defs/").expect("a definition");
            return self.value(&self.definitions[name]);
        }
        if let Some(list) = schema["oneOf"].as_array().or(schema["anyOf"].as_array()) {
            // The last alternative of an optional value is null.
            let ordered: Vec<Value> = list.iter().rev().cloned().collect();
            let chosen = self.any_of(&ordered).clone();
            return self.value(&chosen);
        }
        if let Some(list) = schema["enum"].as_array() {
            return self.any_of(list).clone();
        }
        if let Some(value) = schema.get("const") {
            return value.clone();
        }
        let kind = match &schema["type"] {
            Value::Array(kinds) => {
                if self.below(2) == 0 {
                    return Value::Null;
                }
                &kinds[0]
            }
            kind => kind,
        };
        match kind.as_str() {
            Some("null") => Value::Null,
            Some("boolean") => (self.below(2) == 1).into(),
            Some("string") => self.text().into(),
            Some("integer") => match schema["format"].as_str() {
                Some("int32") => (self.word() as i32).into(),
                // TOML allows integers up to 2^63 - 1.
                Some("uint64") => (self.word() >> 1).into(),
                _ => (self.word() as u32).into(),
            },
            Some("array") => {
                let least = schema["minItems"].as_u64().unwrap_or(0);
                let most = schema["maxItems"].as_u64().unwrap_or(least + 3);
                let count = least + self.below(most - least + 1);
                (0..count).map(|_| self.value(&schema["items"])).collect()
            }
            Some("object") => self.object(schema),
            // A schema without a type describes any value.
            _ => self.number().into(),
        }
    }

    fn object(&mut self, schema: &Value) -> Value {
        let mut out = Map::new();
        for (key, inner) in schema["properties"].as_object().into_iter().flatten() {
            let required = schema["required"].as_array().is_some_and(|list| list.iter().any(|k| k == key));
            if required || self.below(2) == 1 {
                out.insert(key.clone(), self.value(inner));
            }
        }
        if schema["additionalProperties"].is_object() {
            for _ in 0..self.below(4) {
                out.insert(self.text(), self.value(&schema["additionalProperties"]));
            }
        }
        out.retain(|_, value| !value.is_null());
        out.into()
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 600, failure_persistence: None, ..Default::default() })]

    /// Tests that every scene of the JSON schema can be read, and that the scene is equal after writing and
    /// reading.
    #[test]
    #[ignore = "slow: tools/check --all"]
    fn arbitrary_scenes_round_trip(words in prop::collection::vec(any::<u64>(), 0..600)) {
        let schema = schemars::schema_for!(SceneFile).to_value();
        let scene = Choices { words: words.iter(), definitions: &schema["$defs"] }.value(&schema);
        let read = |text: &str| match toml::from_str::<SceneFile>(text) {
            Ok(scene) => Ok(scene),
            Err(e) => Err(TestCaseError::fail(format!("{e}\n{text}"))),
        };
        let scene = read(&toml::to_string(&scene).expect("a text"))?;
        let text = scene.to_toml().expect("a text");
        prop_assert_eq!(scene, read(&text)?, "{}", text);
    }
}
