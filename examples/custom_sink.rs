//! Defines a custom sink that stores the total light of each slice, tile by tile, but no image.
//!
//! `cargo run --release --example custom_sink`

use std::convert::Infallible;
use std::sync::Mutex;
use sunstone::{Field, Job, Piece, Render, SampleCounts, Sink, Summary, TileRecord, scene};

/// A sink that stores the sum of all means of each slice.
#[derive(Default)]
struct Light {
    names: Vec<String>,
    sums: Vec<Mutex<f64>>,
}

impl Sink for Light {
    type Error = Infallible;

    fn begin(&mut self, job: &Job) -> Result<Vec<TileRecord>, Infallible> {
        self.names = job.slices.iter().map(|s| s.layout.name.clone()).collect();
        self.sums = self.names.iter().map(|_| Mutex::default()).collect();
        Ok(vec![]) // no tile is finished yet
    }

    fn put(&self, piece: &Piece) -> Result<(), Infallible> {
        if piece.field == Field::Mean {
            let sum: f64 = piece.data.iter().map(|v| f64::from(*v)).sum();
            *self.sums[piece.slice].lock().expect("no thread panics") += sum;
        }
        Ok(())
    }

    fn put_samples(&self, _: &SampleCounts) -> Result<(), Infallible> {
        Ok(())
    }

    fn tile_done(&self, _: &TileRecord) -> Result<(), Infallible> {
        Ok(())
    }

    fn end(&mut self, summary: &Summary) -> Result<(), Infallible> {
        println!("{} tiles, {} rays", summary.tiles, summary.rays);
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut room = scene::load("scenes/mirror_room/scene.toml".as_ref())?;
    room.change_settings(|s| s.spp = 4);
    let mut light = Light::default();
    Render::new(&room).into_sink(&mut light)?;
    for (name, sum) in light.names.iter().zip(light.sums) {
        println!("{name:14} {:.4e}", sum.into_inner().expect("no thread panics"));
    }
    Ok(())
}
