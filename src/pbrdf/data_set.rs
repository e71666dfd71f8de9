//! Data sets of pBRDFs. A data set contains moments and samples of materials from `.pbsdf` files or of
//! analytic materials.
//!
//! Materials are processed one at a time, with the φ_d slabs of a material in parallel. For a file, memory
//! holds no pages except those that are being read. For an analytic material, memory holds one slab per
//! thread. The angles of the axes are not used, so files with empty axes are accepted.

use crate::table_part::nearest_band;
use optics::spectrum::MAX_WAVELENGTHS;
use polarimetry::reconstruct::pca::data_set::{self, DataSet, Material, Settings};
use polarimetry::reconstruct::pca::gather::Gathered;
use std::path::{Path, PathBuf};
use transport::material::Materials;
use transport::material::measured::axes::Axes;
use transport::material::measured::error::PbsdfError;
use transport::material::measured::table::{Options, Table};
use transport::material::measured::write::slab;

/// Error of reading or creating a data set. The message includes a fix.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// The folder cannot be listed.
    #[error("{}: cannot list the folder: {cause}; pass a folder of .pbsdf files", path.display())]
    Folder { path: PathBuf, cause: std::io::Error },
    /// The folder contains no tables.
    #[error("{}: the folder contains no .pbsdf file; create tables with `sunstone pbrdf synth -o {}`", path.display(), path.display())]
    NoTables { path: PathBuf },
    /// A table is invalid.
    #[error("{}: {cause}", path.display())]
    Table { path: PathBuf, cause: PbsdfError },
    /// The axes are invalid for tables of analytic materials.
    #[error("cannot tabulate the materials: {0}")]
    Axes(PbsdfError),
    /// The list of bands is empty.
    #[error("expected at least one band, got none; pass bands in nanometres")]
    NoBands,
    /// The matrices do not form a valid data set.
    #[error(transparent)]
    Data(#[from] data_set::DataError),
}

/// A named analytic material, with one source per group of bands. The sources are arguments of
/// [`tabulate`](transport::material::measured::write::tabulate).
pub type Analytic<'a> = (String, Vec<(&'a Materials, u32)>);

/// Reads all `.pbsdf` files of a folder at the bands nearest to `bands_nm`, in nanometres. Each band is read
/// once, as measured, without interpolation. If a band is missing, the nearest band is used and a warning is
/// logged.
///
/// # Errors
/// Returns [`DataError`] if the folder or a table cannot be read, if there is no table, or if there is no
/// band.
pub fn read(folder: &Path, bands_nm: &[f64], settings: &Settings) -> Result<DataSet, DataError> {
    let mut files = vec![];
    let failed = |cause| DataError::Folder { path: folder.to_owned(), cause };
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        // Hidden files are unfinished tables.
        let hidden = path.file_name().is_some_and(|n| n.as_encoded_bytes().starts_with(b"."));
        if !hidden && path.extension().is_some_and(|e| e == "pbsdf") {
            files.push(path);
        }
    }
    if files.is_empty() {
        return Err(DataError::NoTables { path: folder.to_owned() });
    }
    files.sort();
    let one = |path: &PathBuf| table(path, bands_nm, settings);
    Ok(DataSet { materials: files.iter().map(one).collect::<Result<_, _>>()? })
}

/// Creates a data set from analytic materials, evaluated at the entries of a table. No table is written.
///
/// # Errors
/// Returns [`DataError`] if the axes are invalid or the matrices do not form a valid data set.
pub fn evaluate(axes: &Axes, materials: &[Analytic], settings: &Settings) -> Result<DataSet, DataError> {
    axes.check().map_err(DataError::Axes)?;
    let len = axes.slab_len().map_err(DataError::Axes)?;
    let bands = axes.wavelengths_nm.len();
    let one = |(name, sources): &Analytic| {
        if sources.len() != bands.div_ceil(MAX_WAVELENGTHS) {
            let sources = sources.len();
            return Err(DataError::Axes(PbsdfError::Sources { bands, sources }));
        }
        Ok(data_set::gather(name, axes.phi_d.len(), settings, |i, gathered| {
            let mut values = vec![0.0; len];
            slab(axes, sources, i, &mut values);
            for m in values.as_chunks::<16>().0 {
                gathered.take(Some(m));
            }
        })?)
    };
    let mut out: Vec<Material> = materials.iter().map(one).collect::<Result<_, _>>()?;
    out.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(DataSet { materials: out })
}

/// Reads one `.pbsdf` file.
fn table(path: &Path, bands_nm: &[f64], settings: &Settings) -> Result<Material, DataError> {
    let options = Options { even_axes: true, ..Options::default() };
    let table =
        Table::open(path, &options).map_err(|cause| DataError::Table { path: path.to_owned(), cause })?;
    let mut bands = vec![];
    for nm in bands_nm {
        let Some(band) = nearest_band(table.wavelengths_nm(), *nm) else {
            continue;
        };
        let found = table.wavelengths_nm()[band];
        if f64::from(found) != *nm {
            tracing::warn!("{}: no band at {nm} nm; using the nearest band, {found} nm", path.display());
        }
        if !bands.contains(&band) {
            bands.push(band);
        }
    }
    if bands.is_empty() {
        return Err(DataError::NoBands);
    }
    let [slabs, theta_d, theta_h] = table.angles().map(<[f32]>::len);
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let gathered = data_set::gather(&name, slabs, settings, |p, gathered: &mut Gathered| {
        for d in 0..theta_d {
            for h in 0..theta_h {
                for band in &bands {
                    gathered.take(table.entry([p, d, h], *band).as_ref());
                }
            }
        }
    });
    Ok(gathered?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use optics::spectrum::Wavelengths;
    use polarimetry::reconstruct::pca::data_set::Weight;
    use polarimetry::reconstruct::pca::gather::Tally;
    use polarimetry::reconstruct::pca::moments::MatrixRow;
    use polarimetry::reconstruct::pca::moments::Moments;
    use scene::materials::MaterialSet;
    use transport::material::measured::write::{tabulate, write};

    /// Writes a table of matrices that depend on their position. One entry is missing, one is dark and one is
    /// unphysical.
    fn made(path: &Path, scale: f32) {
        let axes = Axes::even([5, 3, 4], vec![450, 550, 650]);
        write(path, &axes, |i, values| {
            for (k, m) in values.as_chunks_mut::<16>().0.iter_mut().enumerate() {
                let x = (i * 36 + k) as f32 / 180.0;
                *m = std::array::from_fn(|e| scale * if e == 0 { 1.0 } else { (x * e as f32).sin() * 0.9 });
            }
            let special = [f32::NAN, 0.0, 1e-3];
            if i < 3 {
                values[0] = special[i];
            }
        })
        .unwrap();
    }

    /// Verifies that files are read in the order of their names. The moments must equal those of the table's
    /// entries, and each sample must be an entry of the table.
    #[test]
    fn folders_are_read() {
        let folder = tempfile::tempdir().unwrap();
        for (name, scale) in [("b.pbsdf", 1.0), ("a.pbsdf", 0.25), (".c.pbsdf", 1.0)] {
            made(&folder.path().join(name), scale);
        }
        std::fs::write(folder.path().join("note.txt"), "nothing").unwrap();
        let settings = Settings { c: 8.0, samples: 50 };
        let data = read(folder.path(), &[450.0, 650.0, 451.0], &settings).unwrap();
        let names: Vec<&str> = data.materials.iter().map(|m| m.name.as_str()).collect();
        assert_eq!(names, ["a", "b"]);
        let mut rows: Vec<MatrixRow> = vec![];
        for i in 0..5 {
            for k in (0..36).filter(|k| k % 3 != 1 && !(*k == 0 && i < 3)) {
                let x = (i * 36 + k) as f32 / 180.0;
                rows.push(std::array::from_fn(|e| {
                    if e == 0 { 1.0 } else { f64::from((x * e as f32).sin() * 0.9) }
                }));
            }
        }
        let want = Moments::of(&rows);
        let [a, b] = &data.materials[..] else { panic!("two") };
        let tally = Tally { valid: 117, holes: 1, dark: 1, unreal: 1 };
        assert_eq!((b.tally, b.samples.len()), (tally, 50));
        for i in 0..16 {
            // The elements of the scaled table are rounded to single precision a second time.
            assert!((a.plain.mean()[i] - want.mean()[i]).abs() < 1e-6);
            for j in 0..16 {
                assert!((b.plain.covariance()[i][j] - want.covariance()[i][j]).abs() < 1e-12);
            }
        }
        let is_entry = |s: &[f32; 16]| rows.iter().any(|r| r.map(|e| e as f32) == *s);
        assert!(b.samples.iter().all(is_entry));
        assert_eq!(data.tally().valid, 234);
        assert_eq!(data.plain(Weight::Bins).count(), 234.0);
        let again = read(folder.path(), &[450.0, 650.0], &settings).unwrap();
        assert_eq!(again.materials[1].samples, b.samples);
        assert_eq!(again.mapped(Weight::Bins), data.mapped(Weight::Bins));
    }

    /// Verifies that evaluation in memory is bit-identical to reading a file. The test uses more bands than
    /// one set can contain.
    #[test]
    fn memory_and_file_agree() {
        let text = "[materials]\nm.plastic = { albedo = 0.4, ior = 1.5, alpha = 0.2 }";
        let bands = [450, 500, 550, 600, 650];
        let axes = Axes::even([7, 6, 5], bands.to_vec());
        let sets: Vec<MaterialSet> = bands
            .chunks(MAX_WAVELENGTHS)
            .map(|nm| {
                let nm = Wavelengths::new(nm.iter().copied().map(f64::from).collect()).unwrap();
                MaterialSet::at(Path::new("m.toml"), text, nm).unwrap()
            })
            .collect();
        let sources: Vec<_> = sets.iter().map(|s| (&s.materials, s.names["m"])).collect();
        let folder = tempfile::tempdir().unwrap();
        tabulate(&folder.path().join("m.pbsdf"), &axes, &sources).unwrap();
        let settings = Settings::default();
        let read = read(folder.path(), &bands.map(f64::from), &settings).unwrap();
        let made = evaluate(&axes, &[("m".into(), sources.clone())], &settings).unwrap();
        let ([r], [m]) = (&read.materials[..], &made.materials[..]) else {
            panic!("one each");
        };
        assert!(r.tally.valid > 300 && r.tally.holes > 100, "{:?}", r.tally);
        assert_eq!((&r.plain, &r.mapped, r.tally), (&m.plain, &m.mapped, m.tally));
        assert_eq!((&r.name, &r.samples), (&m.name, &m.samples));
        let few = evaluate(&axes, &[("m".into(), sources[..1].to_vec())], &settings);
        assert!(matches!(few, Err(DataError::Axes(PbsdfError::Sources { .. }))));
    }

    #[test]
    fn errors_name_the_fault_and_fix() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let read = |path: &Path, bands: &[f64], c: f64| {
            let settings = Settings { c, samples: 1 };
            read(path, bands, &settings).err().map_or(String::new(), |e| e.to_string())
        };
        assert!(read(&at.join("none"), &[550.0], 8.0).contains("cannot list"));
        assert!(read(at, &[550.0], 8.0).contains("sunstone pbrdf synth"));
        made(&at.join("a.pbsdf"), 1.0);
        assert!(read(at, &[], 8.0).contains("at least one band"));
        for c in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(read(at, &[550.0], c).contains("positive"), "{c}");
        }
        assert!(read(at, &[f64::NAN], 8.0).is_empty(), "some band serves");
        made(&at.join("dark.pbsdf"), -1.0);
        assert!(read(at, &[550.0], 8.0).contains("dark: no bin is valid"));
        std::fs::write(at.join("dark.pbsdf"), "nothing").unwrap();
        assert!(read(at, &[550.0], 8.0).contains("dark.pbsdf: the file is not a tensor file"));
    }
}
