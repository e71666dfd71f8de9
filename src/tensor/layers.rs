//! Defines ground-truth layers of an image. A layer is an array over camera pixels with a name, a unit and a
//! description.

/// The kind of values per pixel of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parts {
    /// One number per pixel.
    One,
    /// Three world-space coordinates of a vector.
    Vector,
    /// One number per wavelength.
    Wavelengths,
}

/// Values of a layer, row by row from the top of the image. The values of a pixel are contiguous.
#[derive(Clone, Debug, PartialEq)]
pub enum LayerValues {
    /// Real numbers, with NaN for missing values.
    Real(Vec<f32>),
    /// Integers, with -1 for missing values.
    Number(Vec<i32>),
}

/// One ground-truth layer of an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    pub name: &'static str,
    /// Unit of the values, or `1` for values without a unit.
    pub units: &'static str,
    pub long_name: &'static str,
    /// Kind of values per pixel. The array has a third axis, after y and x, unless a pixel has only one
    /// number.
    pub parts: Parts,
    pub values: LayerValues,
    /// Names of the objects or materials, indexed by the values of the layer. The value is `None` for layers
    /// without names.
    pub labels: Option<Vec<String>>,
}

/// The layers of one image.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerSet {
    /// Width and height, in pixels.
    pub size: [u32; 2],
    /// Vacuum wavelengths, in nanometres, of the layers that have one number per wavelength.
    pub wavelengths_nm: Vec<f64>,
    pub layers: Vec<Layer>,
}

impl LayerSet {
    pub fn get(&self, name: &str) -> Option<&Layer> {
        self.layers.iter().find(|l| l.name == name)
    }

    /// Returns the number of values per pixel of a layer.
    pub fn channels(&self, layer: &Layer) -> usize {
        match layer.parts {
            Parts::One => 1,
            Parts::Vector => 3,
            Parts::Wavelengths => self.wavelengths_nm.len(),
        }
    }

    /// Returns the shape of a layer's array: y, x and, if a pixel has several values, the number of values
    /// per pixel.
    pub fn shape(&self, layer: &Layer) -> Vec<u64> {
        let [w, h] = self.size.map(u64::from);
        match layer.parts {
            Parts::One => vec![h, w],
            Parts::Vector | Parts::Wavelengths => vec![h, w, self.channels(layer) as u64],
        }
    }

    /// Returns the values of a layer of real numbers at pixel (x, y), or `None` if the layer or the pixel
    /// does not exist.
    pub fn real(&self, name: &str, x: u32, y: u32) -> Option<&[f32]> {
        let layer = self.get(name)?;
        let LayerValues::Real(values) = &layer.values else {
            return None;
        };
        let n = self.channels(layer);
        let first = (y as usize * self.size[0] as usize + x as usize) * n;
        (x < self.size[0]).then(|| values.get(first..first + n)).flatten()
    }

    /// Returns the number of the object, copy or material at pixel (x, y), or `None` if the layer or the
    /// pixel does not exist.
    pub fn number(&self, name: &str, x: u32, y: u32) -> Option<i32> {
        let LayerValues::Number(values) = &self.get(name)?.values else {
            return None;
        };
        let at = y as usize * self.size[0] as usize + x as usize;
        (x < self.size[0]).then(|| values.get(at).copied()).flatten()
    }

    /// Returns the name of the object or material at pixel (x, y), or `None` if the layer, the pixel or the
    /// value is missing.
    pub fn label(&self, name: &str, x: u32, y: u32) -> Option<&str> {
        let number = usize::try_from(self.number(name, x, y)?).ok()?;
        self.get(name)?.labels.as_ref()?.get(number).map(String::as_str)
    }
}
