//! Tests that files of measured materials follow the documented layout, and that faults in the files are
//! reported. Tests that no input bytes make the reader panic or request more memory than the file needs.

use crate::LARGEST_OF_THREAD;
use crate::harness::folder;
use glam::Vec3A;
use std::f32::consts::{FRAC_PI_2, PI};
use std::path::{Path, PathBuf};
use sunstone::optics::polarization::scatter::Scatter;
use sunstone::optics::sampling::stream::Stream;
use sunstone::scene::materials::MaterialSet;
use sunstone::transport::geometry::ray::Surface;
use sunstone::transport::material::measured::Measured;
use sunstone::transport::material::measured::axes::Axes;
use sunstone::transport::material::measured::error::PbsdfError;
use sunstone::transport::material::measured::table::{Options, Table};
use sunstone::transport::material::measured::write::write;
use sunstone::transport::material::{Lanes, Material, Materials};

/// A field of a file, with name, type code, shape and data.
type FieldOf = (&'static str, u8, Vec<u64>, Vec<u8>);

/// Writes the container according to the format description, without code of the crate. Returns the file and
/// the byte offset of each field's data.
fn container(fields: &[FieldOf]) -> (Vec<u8>, Vec<usize>) {
    let mut out = b"tensor_file\0\x01\x00".to_vec();
    out.extend((fields.len() as u32).to_le_bytes());
    let mut places = vec![];
    for (name, code, shape, _) in fields {
        out.extend((name.len() as u16).to_le_bytes());
        out.extend(name.as_bytes());
        out.extend((shape.len() as u16).to_le_bytes());
        out.push(*code);
        places.push(out.len());
        out.extend([0; 8]);
        for n in shape {
            out.extend(n.to_le_bytes());
        }
    }
    let mut starts = vec![];
    for (place, (.., data)) in places.into_iter().zip(fields) {
        out.resize(out.len().div_ceil(8) * 8, 0);
        starts.push(out.len());
        let offset = out.len() as u64;
        out[place..place + 8].copy_from_slice(&offset.to_le_bytes());
        out.extend(data);
    }
    (out, starts)
}

fn bytes(v: &[f32]) -> Vec<u8> {
    v.iter().flat_map(|x| x.to_le_bytes()).collect()
}

fn axes() -> Axes {
    Axes::even([4, 3, 3], vec![450, 550])
}

/// Returns a positive, finite value for an element. M00 is the largest element.
fn value(element: usize) -> f32 {
    let (k, e) = (element / 16, element % 16);
    (if e == 0 { 1.0 } else { 0.3 - 0.05 * e as f32 }) * (1.0 + 0.01 * k as f32)
}

/// Returns the fields of a small valid table.
fn fields() -> Vec<FieldOf> {
    let a = axes();
    let m: Vec<f32> = (0..4 * 3 * 3 * 2 * 16).map(value).collect();
    vec![
        ("phi_d", 10, vec![1, 4], bytes(&a.phi_d)),
        ("theta_d", 10, vec![1, 3], bytes(&a.theta_d)),
        ("theta_h", 10, vec![1, 3], bytes(&a.theta_h)),
        ("wvls", 3, vec![2], [450_u16, 550].iter().flat_map(|w| w.to_le_bytes()).collect()),
        ("M", 10, vec![4, 3, 3, 2, 4, 4], bytes(&m)),
    ]
}

fn saved(folder: &Path, bytes: &[u8]) -> PathBuf {
    let path = folder.join("table.pbsdf");
    std::fs::write(&path, bytes).expect("a file");
    path
}

/// Tests that the writer's file equals the documented layout byte for byte, and that the folder contains no
/// other files.
#[test]
fn the_writer_writes_the_documented_layout() {
    let folder = folder();
    let path = folder.path().join("t.pbsdf");
    write(&path, &axes(), |phi, slab| {
        let start = phi * slab.len();
        for (i, x) in slab.iter_mut().enumerate() {
            *x = value(start + i);
        }
    })
    .expect("a table");
    assert_eq!(std::fs::read(&path).expect("the file"), container(&fields()).0);
    assert_eq!(std::fs::read_dir(folder.path()).expect("the folder").count(), 1);
    let table = Table::open(&path, &Options::default()).expect("a table");
    let a = axes();
    assert_eq!(table.angles(), [&a.phi_d[..], &a.theta_d, &a.theta_h]);
    assert_eq!(table.wavelengths_nm(), [450, 550]);
}

#[test]
fn the_writer_refuses_axes_that_the_reader_would() {
    let folder = folder();
    let mut a = axes();
    a.theta_h[2] = 3.0;
    let refused = write(&folder.path().join("t.pbsdf"), &a, |_, _| {});
    assert!(matches!(refused, Err(PbsdfError::Angle { axis: "theta_h", .. })), "{refused:?}");
    assert_eq!(std::fs::read_dir(folder.path()).expect("the folder").count(), 0);
    std::fs::write(folder.path().join("no"), "a file, no folder").expect("a file");
    let nowhere = write(&folder.path().join("no/t.pbsdf"), &axes(), |_, _| {});
    assert!(matches!(nowhere, Err(PbsdfError::Write(_))), "{nowhere:?}");
}

/// Tests that the order of fields, the alignment of fields and unknown fields have no effect.
#[test]
fn other_layouts_of_the_same_table_read_equally() {
    let folder = folder();
    let mut shuffled = fields();
    shuffled.reverse();
    shuffled.insert(2, ("note", 1, vec![3], vec![1, 2, 3]));
    shuffled.push(("odd", 77, vec![u64::MAX, 2], vec![]));
    let (mut file, starts) = container(&shuffled);
    // Writes the field M again, at an odd offset.
    let m = &fields()[4].3;
    let at = file.len() as u64 | 1;
    file.resize(at as usize, 0);
    file.extend(m);
    let old = (starts[0] as u64).to_le_bytes();
    let place = file.windows(8).position(|w| w == old).expect("the offset of M");
    file[place..place + 8].copy_from_slice(&at.to_le_bytes());
    let plain =
        Table::open(&saved(folder.path(), &container(&fields()).0), &Options::default()).expect("a table");
    let odd_path = folder.path().join("odd.pbsdf");
    std::fs::write(&odd_path, file).expect("a file");
    let odd = Table::open(&odd_path, &Options::default()).expect("a table");
    let mut stream = Stream::new(5, 0, 0);
    for _ in 0..200 {
        let [a, b] = stream.uniform2();
        let at = sunstone::transport::material::measured::rusinkiewicz::Coordinates {
            phi_d: PI * (2.0 * stream.uniform() - 1.0),
            theta_d: FRAC_PI_2 * a,
            theta_h: FRAC_PI_2 * b,
        };
        assert_eq!(plain.eval(at), odd.eval(at));
        assert!(plain.eval(at).m[0][0].to_array()[0] > 0.9);
    }
}

/// Tests that, after each change to the fields or bytes of a valid file, the error message names the fault.
#[test]
fn errors_name_the_fault_and_fix() {
    type Fields = Vec<FieldOf>;
    type Case = (&'static str, fn(&mut Fields));
    let by_field: Vec<Case> = vec![
        ("missing field `theta_d`", |f| f.retain(|x| x.0 != "theta_d")),
        ("missing field `M`", |f| f.retain(|x| x.0 != "M")),
        ("missing field `wvls`", |f| f.retain(|x| x.0 != "wvls")),
        ("duplicate field `phi_d`", |f| f.push(f[0].clone())),
        ("`M` has elements of type f64", |f| f[4].1 = 11),
        ("`wvls` has elements of type f32", |f| f[3].1 = 10),
        ("`theta_h` has elements of type 200 (unknown)", |f| f[2].1 = 200),
        ("`M` has shape (4, 3, 3, 2, 16)", |f| f[4].2 = vec![4, 3, 3, 2, 16]),
        ("`M` has shape (4, 3, 3, 2, 2, 8)", |f| {
            f[4].2 = vec![4, 3, 3, 2, 2, 8];
        }),
        ("`M` has shape (0, 3, 3, 2, 4, 4)", |f| f[4].2[0] = 0),
        ("`M` has shape ()", |f| f[4].2 = vec![]),
        ("`phi_d` has shape (4), expected (1, 4)", |f| f[0].2 = vec![4]),
        ("`phi_d` has shape (2, 4)", |f| {
            f[0].2 = vec![2, 4];
            f[0].3.extend([0; 16]);
        }),
        ("`theta_d` has shape (1, 4), expected (1, 3)", |f| {
            f[1].2 = vec![1, 4];
            f[1].3.extend([0; 4]);
        }),
        ("`wvls` has shape (1, 2)", |f| f[3].2 = vec![1, 2]),
        ("`M` occupies bytes", |f| f[4].2[0] = 400),
        ("`M` occupies bytes", |f| f[4].2[0] = u64::MAX),
        ("`theta_h` occupies bytes", |f| f[2].2 = vec![1, u64::MAX / 2]),
        ("axis `theta_d` is empty; set even_axes", |f| {
            f[1].2 = vec![0, 3];
            f[1].3.clear();
        }),
        ("axis `phi_d` has 1 entries", |f| {
            f[0].2 = vec![1, 1];
            f[4].2[0] = 1;
        }),
        ("NaN on axis `theta_h`", |f| {
            f[2].3[4..8].copy_from_slice(&f32::NAN.to_le_bytes());
        }),
        ("2 on axis `theta_d` is outside the range; expected radians in 0.0000..1.5708", |f| {
            f[1].3[8..12].copy_from_slice(&2.0_f32.to_le_bytes());
        }),
        ("45 on axis `theta_d`", |f| f[1].3 = bytes(&[0.0, 45.0, 90.0])),
        ("must be strictly increasing", |f| f[1].3 = bytes(&[0.0, 0.5, 0.5])),
        ("550 and 450 on axis `wvls`", |f| {
            f[3].3 = vec![38, 2, 194, 1];
        }),
        ("phi_d covers only 0 to 3", |f| {
            f[0].3 = bytes(&[0.0, 1.0, 2.0, 3.0]);
        }),
        ("no valid entry", |f| {
            f[4].3.chunks_exact_mut(4).for_each(|x| x.copy_from_slice(&f32::NAN.to_le_bytes()));
        }),
    ];
    let folder = folder();
    let check = |words: &str, file: &[u8]| {
        let refused = Table::open(&saved(folder.path(), file), &Options::default());
        let text = refused.err().unwrap_or_else(|| panic!("it loads, without a word of {words}")).to_string();
        assert!(text.contains(words), "`{text}` says nothing of `{words}`");
        assert_eq!(text.matches("; ").count(), 1, "one fault and one fix: {text}");
    };
    for (words, change) in by_field {
        let mut fields = fields();
        change(&mut fields);
        check(words, &container(&fields).0);
    }
    let (whole, _) = container(&fields());
    let edited = |at: usize, to: u8| {
        let mut file = whole.clone();
        file[at] = to;
        file
    };
    check("not a tensor file", b"");
    check("not a tensor file", &edited(0, b'T'));
    check("version 1.7, expected 1.0", &edited(13, 7));
    check("the header is truncated", &{
        let mut fields = fields();
        fields.truncate(5);
        let (mut file, _) = container(&fields);
        file[14] = 6;
        file.truncate(220);
        file
    });
    check("the header is truncated", &whole[..14]);
    check("the header is truncated", &whole[..60]);
    check("the file is truncated", &whole[..whole.len() - 1]);
    let missing = Table::open(&folder.path().join("no.pbsdf"), &Options::default());
    assert!(missing.expect_err("no file").to_string().starts_with("cannot read the file"));
    assert!(Table::open(folder.path(), &Options::default()).is_err(), "a folder");
}

/// Tests that empty axes are evenly spaced if the caller requests even spacing. Tests that the results with
/// empty axes equal the results with explicit axes.
#[test]
fn empty_axes_can_be_evenly_spaced() {
    let folder = folder();
    let mut f = fields();
    for axis in &mut f[..3] {
        axis.2[0] = 0;
        axis.3.clear();
    }
    let path = saved(folder.path(), &container(&f).0);
    assert!(matches!(Table::open(&path, &Options::default()), Err(PbsdfError::EmptyAxis("phi_d"))));
    let even = Options { even_axes: true, ..Options::default() };
    let table = Table::open(&path, &even).expect("a table");
    let a = axes();
    assert_eq!(table.angles(), [&a.phi_d[..], &a.theta_d, &a.theta_h]);
}

/// Tests that errors of a table in a materials file state the location, the path, the fault and the fix.
/// Tests that the hash depends on the data. If another program truncates a file while the file is open, the
/// values must not change.
#[test]
fn a_small_table_is_independent_of_its_file() {
    let folder = folder();
    let (file, _) = container(&fields());
    let path = saved(folder.path(), &file);
    let table = Table::open(&path, &Options::default()).expect("a table");
    let all = |t: &Table| -> Vec<Option<[f32; 16]>> {
        let places = (0..4).flat_map(|p| (0..3).flat_map(move |d| (0..3).map(move |h| [p, d, h])));
        places.flat_map(|at| [0, 1].map(|band| t.entry(at, band))).collect()
    };
    let before = all(&table);
    assert!(before.iter().all(Option::is_some));
    std::fs::write(&path, b"").expect("an empty file");
    assert_eq!(all(&table), before);
    assert_eq!(table.file_len(), file.len());
}

/// Tests that a large file is memory-mapped, and that a table after 65 MiB of zeros in the file gives correct
/// entries.
#[test]
fn a_large_table_is_mapped() {
    let folder = tempfile::tempdir().expect("a folder");
    let (file, starts) = container(&fields());
    let path = saved(folder.path(), &file);
    let opened = std::fs::OpenOptions::new().write(true).open(&path).expect("a file");
    opened.set_len(65 << 20).expect("space that is not filled");
    let table = Table::open(&path, &Options::default()).expect("a table");
    assert_eq!(table.file_len(), 65 << 20);
    let first = table.entry([0, 0, 0], 0).expect("an entry");
    let at = starts[4];
    assert_eq!(bytes(&first), file[at..at + 64]);
}

#[test]
fn errors_name_the_position_and_the_file() {
    let folder = folder();
    saved(folder.path(), &container(&fields()).0[..500]);
    let text = "wavelengths_nm = [450]\n[materials]\nx.measured = { file = \"table.pbsdf\" }\n";
    let at = folder.path().join("materials.toml");
    let error = MaterialSet::from_text(&at, text).err().expect("a short file");
    assert_eq!(error.line_column(), Some((3, 23)));
    assert!(error.message.contains("table.pbsdf: the file is truncated: `M`"), "{}", error.message);
    assert!(error.help.as_deref().is_some_and(|h| h.contains("download the file again")), "{:?}", error.help);
    saved(folder.path(), &container(&fields()).0);
    assert!(MaterialSet::from_text(&at, text).is_ok());
    let unknown = MaterialSet::from_text(&at, &text.replace("file =", "path ="));
    assert!(unknown.err().expect("an unknown key").message.contains("unknown key `path`"));
}

/// Tests that the hashes of a table's pieces distinguish tables. Tests that the scene hash depends on the
/// hashes of the pieces. The pieces of a large file are the header, the axes and 64 parts of the data. The
/// hash always detects a changed byte range that is at least as long as the distance between two parts.
#[test]
fn scene_hashes_depend_on_the_pieces_of_tables() {
    let folder = folder();
    let small = saved(folder.path(), &container(&fields()).0);
    let table = Table::open(&small, &Options::default()).expect("a table");
    assert!(table.pieces().eq(std::iter::once(0..table.file_len())));
    let axes = Axes::even([73, 31, 31], vec![550]);
    write(&small, &axes, |_, slab| slab.fill(0.25)).expect("a table");
    let table = Table::open(&small, &Options::default()).expect("a table");
    let read: usize = table.pieces().map(|r| r.len()).sum();
    assert_eq!(read, 211 + 4 * (73 + 31 + 31) + 2 + 64 * 4096);
    let hash = || {
        let text = "[camera]\nresolution = [2, 2]\nfov_x_deg = 50\n\
                    pose.look_at = { origin = [0, 0, 1], target = [0, 0, 0] }\n[[emitters]]\nenvironment.radiance = 1\n\
                    [materials]\nx.measured = { file = \"table.pbsdf\" }\n";
        let scene = sunstone::scene::from_text(&folder.path().join("scene.toml"), text);
        scene.unwrap_or_else(|e| panic!("{e}")).sha256.clone()
    };
    let before = hash();
    let whole = std::fs::read(&small).expect("the file");
    let data = 73 * 31 * 31 * 64;
    let start = whole.len() - data;
    let stretch = start + 1_000_000..start + 1_000_000 + data / 63;
    for change in [216..217, stretch, whole.len() - 1..whole.len()] {
        let mut file = whole.clone();
        file[change.clone()].iter_mut().for_each(|x| *x ^= 1);
        std::fs::write(&small, file).expect("a file");
        assert_ne!(before, hash(), "{change:?}");
    }
    std::fs::write(&small, whole).expect("a file");
    assert_eq!(before, hash());
}

fn surface() -> Surface {
    Surface {
        p: Vec3A::ZERO,
        ng: Vec3A::Z,
        ns: Vec3A::Z,
        tangent: Vec3A::X,
        bitangent: Vec3A::ZERO,
        uv: [0.0; 2],
        material: 0,
        rounding: 0.0,
    }
}

fn finite(s: &Scatter) -> bool {
    let Scatter::Full { mueller, .. } = s else {
        return false;
    };
    mueller.m.iter().flatten().all(|e| e.to_array().iter().all(|x| x.is_finite()))
}

/// Asserts that some values and samples of a table are finite.
fn assert_finite(table: Table, stream: &mut Stream, what: &str) {
    let materials = Materials {
        list: vec![Material::Measured(Measured { table: 0 })],
        tables: vec![table],
        ..Materials::default()
    };
    let at = surface();
    for _ in 0..4 {
        let mut toward = || {
            let [u, v] = stream.uniform2();
            let (z, phi) = (u * u, 7.0 * v);
            let r = (1.0 - z * z).sqrt();
            Vec3A::new(r * phi.cos(), r * phi.sin(), z)
        };
        let (wo, wi) = (toward(), toward());
        if let Some(s) = materials.eval(0, &at, wo, wi) {
            assert!(finite(&s), "{what}: {s:?}");
        }
        assert!(materials.pdf(0, &at, wo, wi).is_finite(), "{what}: {wo} {wi}");
        if let Some(s) = materials.sample(0, &at, wo, &mut Lanes::first(3), stream) {
            assert!(finite(&s.scatter) && s.wi.is_finite(), "{what}: {s:?}");
        }
    }
}

/// Tests that each of 10,000 mutated valid files loads or gives an error. The mutations are truncation,
/// flipped bits, replaced header numbers and random bytes.
#[test]
fn mutated_files_load_or_give_an_error() {
    const EXTREME: [u64; 8] = [0, 1, 2, 255, 0x7fff_ffff, u64::MAX / 2, u64::MAX - 7, u64::MAX];
    let folder = folder();
    let whole = container(&fields()).0;
    let head = 211;
    let (mut loaded, mut refused) = (0, 0);
    let mut stream = Stream::new(77, 0, 0);
    for case in 0..10_000 {
        let mut file = whole.clone();
        let mut below = |n: usize| ((stream.uniform() * n as f32) as usize).min(n - 1);
        for _ in 0..=below(3) {
            let n = file.len();
            match below(6) {
                0 => file.truncate(below(n) + 1),
                1 => file[below(n)] ^= 1 << below(8),
                2 => {
                    let at = below(head.min(n));
                    file[at] = below(256) as u8;
                }
                3 => {
                    let (at, word) = (below(head.min(n)), EXTREME[below(8)].to_le_bytes());
                    for (to, from) in file[at..].iter_mut().zip(&word[..[1, 2, 4, 8][below(4)]]) {
                        *to = *from;
                    }
                }
                4 => {
                    let at = below(n);
                    let length = below(64) + 1;
                    for x in file[at..].iter_mut().take(length) {
                        *x = below(256) as u8;
                    }
                }
                _ => {
                    // Sets all values of one matrix element to an extreme value.
                    let to = [f32::NAN, f32::INFINITY, f32::MAX, -1.0, f32::MIN_POSITIVE, 9e8][below(6)];
                    let at = below(n) & !3;
                    for (x, y) in file[at..].iter_mut().zip(to.to_le_bytes()) {
                        *x = y;
                    }
                }
            }
        }
        let path = saved(folder.path(), &file);
        let options = Options { even_axes: case % 2 == 0, ..Options::default() };
        LARGEST_OF_THREAD.set(0);
        let table = Table::open(&path, &options);
        let largest = LARGEST_OF_THREAD.get();
        // The files are small, so messages and importance tables dominate the memory.
        let allowed = (2 * file.len()).max(8192);
        assert!(largest <= allowed, "case {case}: {largest} bytes for a file of {}", file.len());
        match table {
            Ok(table) => {
                loaded += 1;
                assert_finite(table, &mut stream, &format!("case {case}"));
            }
            Err(e) => {
                refused += 1;
                assert_eq!(e.to_string().matches("; ").count(), 1, "case {case}: {e}");
            }
        }
    }
    println!("{loaded} loaded, {refused} refused");
    assert!(loaded > 2000 && refused > 2000, "{loaded} loaded, {refused} refused");
}
