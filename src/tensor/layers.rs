//! Ground truth of an image, layer by layer: arrays over camera pixels with their names, units and meaning.

/// What follows the pixel in a layer's array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parts {
    /// One number a pixel.
    One,
    /// The three coordinates of a vector, world frame.
    Vector,
    /// One number a wavelength.
    Wavelengths,
}

/// Numbers of a layer, row by row from the image's top, a pixel's own fastest.
#[derive(Clone, Debug, PartialEq)]
pub enum LayerValues {
    /// NaN where there is nothing.
    Real(Vec<f32>),
    /// -1 where there is nothing.
    Number(Vec<i32>),
}

/// One array of ground truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Its name.
    pub name: &'static str,
    /// Unit of its values, `1` for none.
    pub units: &'static str,
    /// What it is, for people.
    pub long_name: &'static str,
    /// What follows y and x in its shape.
    pub parts: Parts,
    /// Its numbers.
    pub values: LayerValues,
    /// What the numbers of objects and materials stand for, by number.
    pub labels: Option<Vec<String>>,
}

/// The layers of one image.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerSet {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Of layers with a number a wavelength.
    pub wavelengths_nm: Vec<f64>,
    /// The layers.
    pub layers: Vec<Layer>,
}

impl LayerSet {
    /// The layer of a name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Layer> {
        self.layers.iter().find(|l| l.name == name)
    }

    /// Numbers a pixel in a layer.
    #[must_use]
    pub fn channels(&self, layer: &Layer) -> usize {
        match layer.parts {
            Parts::One => 1,
            Parts::Vector => 3,
            Parts::Wavelengths => self.wavelengths_nm.len(),
        }
    }

    /// Shape of a layer's array: y, x and, where a pixel has several numbers, those.
    #[must_use]
    pub fn shape(&self, layer: &Layer) -> Vec<u64> {
        let [w, h] = self.size.map(u64::from);
        match layer.parts {
            Parts::One => vec![h, w],
            Parts::Vector | Parts::Wavelengths => vec![h, w, self.channels(layer) as u64],
        }
    }

    /// The numbers of a layer of real numbers at pixel (x, y); `None` if there is no such layer, or no such pixel.
    #[must_use]
    pub fn real(&self, name: &str, x: u32, y: u32) -> Option<&[f32]> {
        let layer = self.get(name)?;
        let LayerValues::Real(values) = &layer.values else {
            return None;
        };
        let n = self.channels(layer);
        let first = (y as usize * self.size[0] as usize + x as usize) * n;
        (x < self.size[0]).then(|| values.get(first..first + n)).flatten()
    }

    /// The number of an object, a copy or a material at pixel (x, y); `None` as in [`Self::real`].
    #[must_use]
    pub fn number(&self, name: &str, x: u32, y: u32) -> Option<i32> {
        let LayerValues::Number(values) = &self.get(name)?.values else {
            return None;
        };
        let at = y as usize * self.size[0] as usize + x as usize;
        (x < self.size[0]).then(|| values.get(at).copied()).flatten()
    }

    /// What a number at pixel (x, y) stands for; `None` where there is nothing, too.
    #[must_use]
    pub fn label(&self, name: &str, x: u32, y: u32) -> Option<&str> {
        let number = usize::try_from(self.number(name, x, y)?).ok()?;
        self.get(name)?.labels.as_ref()?.get(number).map(String::as_str)
    }
}
