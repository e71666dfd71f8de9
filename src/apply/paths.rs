//! Computes light by path type, from a slice that has axes for labels ([`tensor::label`]) and for numbers of
//! surface interactions.
//!
//! Light components are sets of pairs (label, bounces). A label does not contain the order of interactions.
//! Light from a mirror to a wall and light from a wall to a mirror therefore have the same path type.

use crate::error::ApplyError;
use crate::map::Map;
use crate::observation::Observation;
use tensor::array::Tensor;
use tensor::axes::AxisKind;
use tensor::label::{DIFFUSE, GLOSSY, MEDIUM, SPECULAR};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Path {
    /// The set of interactions, as bits of [`tensor::label`].
    pub label: u8,
    /// Number of surface interactions between projector and camera.
    pub bounces: u32,
}

impl Path {
    /// Returns whether the path consists of a single reflection by a matte surface.
    pub fn single_diffuse(self) -> bool {
        self.label == DIFFUSE && self.bounces == 1
    }

    /// Returns whether the path has two or more reflections, all by matte surfaces.
    pub fn diffuse_interreflection(self) -> bool {
        self.label == DIFFUSE && self.bounces > 1
    }

    /// Returns whether all reflections are by mirrors or microfacets.
    pub fn all_specular(self) -> bool {
        self.label & (SPECULAR | GLOSSY) != 0 && self.label & (DIFFUSE | MEDIUM) == 0
    }

    /// Returns whether the path consists of a single reflection by a mirror or by microfacets.
    pub fn single_specular(self) -> bool {
        self.all_specular() && self.bounces == 1
    }

    /// Returns whether the path has two or more reflections, all by mirrors or microfacets.
    pub fn multi_specular(self) -> bool {
        self.all_specular() && self.bounces > 1
    }

    /// Returns whether the path includes a reflection by a smooth surface and a reflection by a matte
    /// surface.
    pub fn mirror_and_diffuse(self) -> bool {
        self.label & SPECULAR != 0 && self.label & DIFFUSE != 0
    }

    /// Returns whether the path has one reflection by a mirror and one reflection by a matte surface, in any
    /// order. One example is light that a mirror reflects to a wall. Another example is light that a wall
    /// scatters to a mirror.
    pub fn one_mirror_one_diffuse(self) -> bool {
        self.label == SPECULAR | DIFFUSE && self.bounces == 2
    }
}

/// A slice with axes for labels and for numbers of bounces.
pub struct Labelled<'a> {
    pub tensor: &'a Tensor,
    /// All path types of the slice.
    pub kinds: Vec<Path>,
    camera: [usize; 2],
    bin: Option<usize>,
    path: [usize; 2],
}

impl<'a> Labelled<'a> {
    /// Returns the labelled slice of an observation.
    ///
    /// # Errors
    /// [`ApplyError::Missing`] if the slice is missing. [`ApplyError::Axis`] if the slice lacks rows and
    /// columns, labels or bounces.
    pub fn of(o: &'a Observation, name: &str) -> Result<Self, ApplyError> {
        let tensor = &o.slice(name)?.mean;
        let of = |kind: AxisKind, axis: &'static str| {
            tensor.find(kind).ok_or(ApplyError::Axis { variant: o.variant, slice: name.to_owned(), axis })
        };
        let rows_and_columns = "rows and columns of the camera";
        let camera = [of(AxisKind::Y, rows_and_columns)?, of(AxisKind::X, rows_and_columns)?];
        let [label, bounces] = [of(AxisKind::Label, "labels")?, of(AxisKind::Bounces, "bounces")?];
        let coords = |axis: usize| tensor.axes[axis].coords.iter().map(|c| c.max(0.0));
        let kinds = coords(bounces)
            .flat_map(|b| coords(label).map(move |l| Path { label: l as u8, bounces: b as u32 }))
            .collect();
        Ok(Self { tensor, kinds, camera, bin: tensor.find(AxisKind::T), path: [bounces, label] })
    }

    /// Calls `f` for each value with four arguments:
    /// - the pixel index,
    /// - the bin of travel time (0 without a time axis),
    /// - the index of the path in `kinds`,
    /// - the light (M00 for matrices).
    pub fn walk(&self, mut f: impl FnMut(usize, usize, usize, f64)) {
        let t = self.tensor;
        let ([y, x], [bounces, label]) = (self.camera, self.path);
        let [columns, labels] = [x, label].map(|a| t.axes[a].coords.len());
        let stokes = [AxisKind::StokesOut, AxisKind::StokesIn].map(|kind| t.find(kind));
        t.walk(|index, place| {
            if stokes.iter().flatten().all(|a| index[*a] == 0) {
                let pixel = index[y] * columns + index[x];
                let kind = index[bounces] * labels + index[label];
                f(pixel, self.bin.map_or(0, |a| index[a]), kind, f64::from(t.data[place]));
            }
        });
    }
}

/// The intensity of a slice by path. The intensity is summed over wavelengths and over all axes except
/// camera, label and bounces.
#[derive(Clone, Debug, PartialEq)]
pub struct Paths {
    pub width: usize,
    pub height: usize,
    kinds: Vec<Path>,
    /// The light of each path type in each pixel, `[pixel][kind]`.
    light: Vec<f64>,
}

impl Paths {
    /// Sums a slice of an observation by path.
    ///
    /// # Errors
    /// [`ApplyError::Missing`] if the slice is missing. [`ApplyError::Axis`] if the slice lacks rows and
    /// columns, labels or bounces.
    pub fn read(o: &Observation, name: &str) -> Result<Self, ApplyError> {
        let slice = Labelled::of(o, name)?;
        let [width, height] = [AxisKind::X, AxisKind::Y].map(|kind| slice.tensor.extent(kind));
        let kinds = slice.kinds.len();
        let mut light = vec![0.0; width * height * kinds];
        slice.walk(|pixel, _, kind, value| light[pixel * kinds + kind] += value);
        Ok(Self { width, height, kinds: slice.kinds, light })
    }

    /// Returns an image of the light, summed over all paths that satisfy `is`.
    pub fn of(&self, is: impl Fn(Path) -> bool) -> Map {
        let chosen: Vec<usize> = (0..self.kinds.len()).filter(|k| is(self.kinds[*k])).collect();
        Map::from_fn(self.width, self.height, 1, |x, y, out| {
            let first = (y * self.width + x) * self.kinds.len();
            out[0] = chosen.iter().map(|k| self.light[first + k]).sum();
        })
    }

    pub fn all(&self) -> Map {
        self.of(|_| true)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::observation::Slice;
    use crate::observation::tests::zeros;

    /// Returns a slice of light by path from a function of pixel and path.
    pub(crate) fn labelled(
        [width, height]: [usize; 2],
        max_bounces: usize,
        wavelengths: usize,
        mut light: impl FnMut(usize, Path) -> f64,
    ) -> Slice {
        let axes = [
            (AxisKind::Y, height),
            (AxisKind::X, width),
            (AxisKind::Bounces, max_bounces),
            (AxisKind::Label, 16),
            (AxisKind::Wavelength, wavelengths),
        ];
        let mut mean = zeros("paths", axes);
        for (i, v) in mean.data.iter_mut().enumerate() {
            let rest = i / wavelengths;
            let path = Path { label: (rest % 16) as u8, bounces: (rest / 16 % max_bounces) as u32 };
            *v = light(rest / 16 / max_bounces, path) as f32;
        }
        Slice { error: mean.clone(), mean }
    }

    fn observation(slice: Slice) -> Observation {
        let mut o = Observation::default();
        o.slices.insert("paths".into(), slice);
        o
    }

    #[test]
    fn sums_contain_exactly_the_named_paths() {
        // Every path contributes a unique power of two at every wavelength, so a sum identifies the paths in
        // the sum.
        let bring = |p: Path| f64::from(1_u32 << (p.label / 2)) * f64::from(1_u32 << (8 * p.bounces.min(2)));
        let even = |p: Path| p.label.is_multiple_of(2);
        let o =
            observation(labelled(
                [3, 2],
                3,
                2,
                |pixel, p| {
                    if even(p) { (pixel + 1) as f64 * bring(p) } else { 0.0 }
                },
            ));
        let paths = Paths::read(&o, "paths").expect("paths");
        assert_eq!((paths.width, paths.height), (3, 2));
        let sum = |kinds: &[(u8, u32)]| -> f64 {
            let each = kinds.iter().map(|&(label, bounces)| bring(Path { label, bounces }));
            2.0 * each.sum::<f64>()
        };
        type Case = (fn(Path) -> bool, &'static [(u8, u32)]);
        let cases: [Case; 7] = [
            (Path::single_diffuse, &[(8, 1)]),
            (Path::diffuse_interreflection, &[(8, 2)]),
            (Path::single_specular, &[(2, 1), (4, 1), (6, 1)]),
            (Path::multi_specular, &[(2, 2), (4, 2), (6, 2)]),
            (Path::mirror_and_diffuse, &[(10, 0), (14, 0), (10, 1), (14, 1), (10, 2), (14, 2)]),
            (Path::one_mirror_one_diffuse, &[(10, 2)]),
            (Path::all_specular, &[(2, 0), (4, 0), (6, 0), (2, 1), (4, 1), (6, 1), (2, 2), (4, 2), (6, 2)]),
        ];
        for (k, (kind, of)) in cases.iter().enumerate() {
            let map = paths.of(kind);
            for pixel in 0..6 {
                let found = map.at(pixel % 3, pixel / 3)[0];
                assert_eq!(found, (pixel + 1) as f64 * sum(of), "case {k}");
            }
        }
        // The sum over disjoint and exhaustive sets of paths is all light.
        let (all, one, rest) = (paths.all(), paths.of(Path::all_specular), paths.of(|p| !p.all_specular()));
        for ((a, b), c) in all.data.iter().zip(&one.data).zip(&rest.data) {
            assert_eq!(*a, b + c);
        }
    }

    #[test]
    fn slices_without_labels_or_bounces_are_refused() {
        let plain = labelled([2, 2], 2, 1, |_, _| 1.0);
        for kind in [AxisKind::Label, AxisKind::Bounces, AxisKind::X] {
            let o = observation(Slice { mean: plain.mean.sum(kind), error: plain.error.sum(kind) });
            assert!(matches!(Paths::read(&o, "paths"), Err(ApplyError::Axis { .. })), "{kind:?}");
        }
        assert!(matches!(Paths::read(&Observation::default(), "paths"), Err(ApplyError::Missing { .. })));
    }
}
