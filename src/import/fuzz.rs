//! Property tests: the parsers do not panic for any input.

use std::sync::LazyLock;

use proptest::prelude::*;
use proptest::sample::Index;

use super::{draco_tests, gltf_tests, parse_gltf, parse_obj, parse_ply};

const OBJ: &str = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0 1\nv 0 1 0 .5 .5 .5\nvt 0 0\nvt 1 1\nvn 0 0 1\no a b\n\
    usemtl glass\nf 1/1/1 2/2/1 3/1/1 4/2/1\ng x\nf -4//-1 -3//-1 \\\n-2//-1\nf 1 2 4\nl 1 2\n";
const PLY_ASCII: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
    property double z\nproperty float nx\nproperty float ny\nproperty float nz\nelement face 2\n\
    property list uchar int vertex_indices\nelement edge 1\nproperty list int float w\nend_header\n\
    0 0 0 0 0 1\n1 0 0 0 0 1\n1 1 0 0 0 1\n0 1 0 0 0 1\n3 0 1 2\n4 0 1 2 3\n2 1 2\n";

fn ply_binary() -> Vec<u8> {
    let mut b =
        b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nelement face 1\nproperty list uint uint vertex_index\nend_header\n"
            .to_vec();
    for x in [0., 0., 0., 1., 0., 0., 0., 1., 0.0_f32] {
        b.extend(x.to_le_bytes());
    }
    for i in [3, 0, 1, 2_u32] {
        b.extend(i.to_le_bytes());
    }
    b
}

/// Valid files that the tests mutate.
static SEEDS: LazyLock<[Vec<u8>; 6]> = LazyLock::new(|| {
    [
        OBJ.into(),
        PLY_ASCII.into(),
        ply_binary(),
        gltf_tests::sample_glb(),
        gltf_tests::sample_gltf(),
        draco_tests::sample_glb(),
    ]
});

/// Words that have caused parser errors before, separated by spaces.
const WORDS: &str =
    "-1 0 4294967295 18446744073709551615 6148914691236517206 1e999 nan - / \n \\\n null [ 5121";

fn word(i: usize) -> impl Iterator<Item = u8> {
    WORDS.split(' ').nth(i).unwrap_or_default().bytes()
}

fn parse_all(bytes: &[u8]) {
    // Ignore the results, because only the absence of a panic is tested.
    let _ = parse_obj(bytes);
    let _ = parse_ply(bytes);
    let _ = parse_gltf(bytes, None);
}

#[derive(Clone, Debug)]
enum Edit {
    Flip(Index, u8),
    Cut(Index),
    Delete(Index, usize),
    Insert(Index, usize),
    /// Replaces the first number at or after a position in the file.
    Number(Index, usize),
}

fn edits() -> impl Strategy<Value = Vec<Edit>> {
    let word = 0..WORDS.split(' ').count();
    let edit = prop_oneof![
        4 => (any::<Index>(), any::<u8>()).prop_map(|(i, b)| Edit::Flip(i, b)),
        1 => any::<Index>().prop_map(Edit::Cut),
        2 => (any::<Index>(), 1..40_usize).prop_map(|(i, n)| Edit::Delete(i, n)),
        2 => (any::<Index>(), word.clone()).prop_map(|(i, w)| Edit::Insert(i, w)),
        6 => (any::<Index>(), word).prop_map(|(i, w)| Edit::Number(i, w)),
    ];
    prop::collection::vec(edit, 1..4)
}

fn apply(bytes: &mut Vec<u8>, edit: &Edit) {
    if bytes.is_empty() {
        return;
    }
    let length = bytes.len();
    match edit {
        Edit::Flip(at, b) => bytes[at.index(length)] ^= b,
        Edit::Cut(at) => bytes.truncate(at.index(length)),
        Edit::Delete(at, n) => {
            let from = at.index(length);
            bytes.drain(from..(from + n).min(length));
        }
        Edit::Insert(at, w) => {
            let at = at.index(length);
            bytes.splice(at..at, word(*w));
        }
        Edit::Number(at, w) => {
            let digit = |b: &u8| b.is_ascii_digit();
            let at = at.index(length);
            let from = at + bytes[at..].iter().position(digit).unwrap_or(0);
            let n = bytes[from..].iter().take_while(|b| digit(b)).count();
            bytes.splice(from..from + n, word(*w));
        }
    }
}

#[test]
fn fuzz_seeds_are_valid() {
    parse_obj(&SEEDS[0]).unwrap();
    parse_ply(&SEEDS[1]).unwrap();
    parse_ply(&SEEDS[2]).unwrap();
    parse_gltf(&SEEDS[3], None).unwrap();
    parse_gltf(&SEEDS[4], None).unwrap();
    parse_gltf(&SEEDS[5], None).unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..Default::default() })]

    #[test]
    fn arbitrary_bytes_never_panic(
        head in prop::sample::select(&["", "ply\nformat ascii 1.0\n", "glTF\x02\0\0\0", "{\"asset\":", "f "][..]),
        tail in prop::collection::vec(any::<u8>(), 0..300),
    ) {
        parse_all(&[head.as_bytes(), &tail].concat());
    }

    #[test]
    fn arbitrary_text_never_panics(text in "(ply\n)?([vfo] |vn |element vertex |property float |[0-9./\\-]{1,9}|\n| ){0,60}") {
        parse_all(text.as_bytes());
    }

    #[test]
    fn mutants_never_panic(seed in 0..6_usize, edits in edits()) {
        let mut bytes = SEEDS[seed].clone();
        for edit in &edits {
            apply(&mut bytes, edit);
        }
        match seed {
            0 => _ = parse_obj(&bytes),
            1 | 2 => _ = parse_ply(&bytes),
            _ => _ = parse_gltf(&bytes, None),
        }
    }
}
