//! Writes ground-truth layers as one `.npz` file with one array per layer, the names of objects and
//! materials, and the wavelengths.
//!
//! NumPy reads the file without pickle, because names are arrays of Unicode text
//! (`numpy.load(f)["object_names"][3]`).

use super::numpy::write;
use base::npy::write_header;
use base::whole_file;
use std::io::{self, Write};
use std::path::Path;
use tensor::layers::{LayerSet, LayerValues};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Writes texts as a `.npy` array of little-endian UCS-4 texts that are padded to equal width.
fn write_texts(out: &mut impl Write, texts: &[String]) -> io::Result<()> {
    let width = texts.iter().map(|t| t.chars().count()).max().unwrap_or(0).max(1);
    write_header(out, &format!("<U{width}"), &[texts.len()])?;
    for text in texts {
        let mut letters = text.chars().map(u32::from).chain(std::iter::repeat(0));
        for _ in 0..width {
            out.write_all(&letters.next().unwrap_or(0).to_le_bytes())?;
        }
    }
    Ok(())
}

/// Writes layers to a `.npz` file, atomically.
///
/// # Errors
/// Returns an error if the file cannot be written.
pub fn write_npz(path: &Path, set: &LayerSet) -> io::Result<()> {
    whole_file::write_with(path, |file| {
        let mut zip = ZipWriter::new(file);
        let options =
            SimpleFileOptions::default().compression_method(CompressionMethod::Deflated).large_file(true);
        for layer in &set.layers {
            let shape: Vec<usize> = set.shape(layer).iter().map(|n| *n as usize).collect();
            zip.start_file(format!("{}.npy", layer.name), options)?;
            match &layer.values {
                LayerValues::Real(values) => write(&mut zip, &shape, values.iter().copied())?,
                LayerValues::Number(values) => write(&mut zip, &shape, values.iter().copied())?,
            }
            if let Some(labels) = &layer.labels {
                zip.start_file(format!("{}_names.npy", layer.name), options)?;
                write_texts(&mut zip, labels)?;
            }
        }
        zip.start_file("wavelengths_nm.npy", options)?;
        let nm = &set.wavelengths_nm;
        write(&mut zip, &[nm.len()], nm.iter().copied())?;
        zip.finish()?.flush()
    })
}
