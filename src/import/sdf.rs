//! Computes a triangle mesh of the surface on which a distance grid is zero, with the interpolation of
//! Mitsuba 3's `sdfgrid`.
//!
//! The distance is interpolated trilinearly between grid points. Cells in which the distance changes sign are
//! subdivided until the triangles are close enough to the surface. Each subcell is split into six tetrahedra
//! (Kuhn 1960), so that adjacent cells have the same triangle edges on their common face.

use super::error::ImportError;
use super::vol::Vol;
use glam::{DVec3, Vec2};
use std::collections::HashMap;
use transport::geometry::mesh::Mesh;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Normals {
    /// Normals are gradients of each cell. The gradients are discontinuous between cells.
    Analytic,
    /// Normals are weighted gradients of eight cells (Hansson-Söderlund, Evans, Akenine-Möller, JCGT 11(3),
    /// 2022).
    Smooth,
}

#[derive(Clone, Debug)]
pub struct Surface {
    /// Triangles in the cube [0, 1]³ that face toward increasing distance. Texture coordinates are constant,
    /// as in Mitsuba.
    pub mesh: Mesh,
    /// Largest distance (in cell sizes, to first order) of a triangle's centre from the trilinear surface.
    pub deviation: f64,
}

/// Constant texture coordinate. The coordinate lies inside the checkerboard square that Mitsuba evaluates.
/// Mitsuba's value is 0, which is a corner of several squares of a checkerboard.
const UV: Vec2 = Vec2::splat(1e-6);
const MOST: usize = 4_000_000;
/// Deviation from the surface, in cell sizes, at which subdivision stops.
const NEAR: f64 = 0.02;
const PARTS: usize = 4;
const FIX: &str =
    "provide at least 2 x 2 x 2 points with one distance per point; some of the distances must be negative";

/// Computes a triangle mesh of the surface on which the distance is zero.
///
/// # Errors
/// Returns [`ImportError`] if the grid has several numbers per point, fewer than two points along an axis, or
/// no change of sign. Returns [`ImportError`] if the surface needs more than 4 million triangles.
pub fn surface(vol: &Vol, normals: Normals) -> Result<Surface, ImportError> {
    let [x, y, z] = vol.size;
    if vol.channels != 1 || vol.size.iter().any(|n| *n < 2) {
        let what = format!("the grid has {x} x {y} x {z} points with {} values per point", vol.channels);
        return Err(ImportError::new(what, FIX));
    }
    let grid = Grid { size: vol.size, values: &vol.values };
    let mut parts = 1;
    let mut best = grid.surface(parts, normals);
    while let Some(found) = &best
        && found.deviation > NEAR
        && parts < PARTS
    {
        parts *= 2;
        match grid.surface(parts, normals) {
            Some(finer) => best = Some(finer),
            None => break,
        }
    }
    match best {
        None => {
            Err(ImportError::new(format!("the surface has more than {MOST} triangles"), "use fewer points"))
        }
        Some(found) if found.mesh.indices.is_empty() => Err(ImportError::new(
            "all distances of the grid have the same sign, so the grid contains no surface",
            FIX,
        )),
        Some(found) => Ok(found),
    }
}

struct Grid<'a> {
    size: [usize; 3],
    values: &'a [f32],
}

impl Grid<'_> {
    /// Returns the distance at a position, in units of the cell size from the first grid point.
    /// Positions outside the grid are clamped to the grid's edge.
    fn at(&self, p: DVec3) -> f64 {
        let (mut low, mut part) = ([0; 3], [0.0; 3]);
        for i in 0..3 {
            let last = self.size[i] - 2;
            low[i] = (p[i].max(0.0) as usize).min(last);
            part[i] = (p[i] - low[i] as f64).clamp(0.0, 1.0);
        }
        let mut sum = 0.0;
        for corner in 0..8 {
            let (mut weight, mut at) = (1.0, [0; 3]);
            for i in 0..3 {
                let up = corner >> i & 1;
                weight *= if up == 1 { part[i] } else { 1.0 - part[i] };
                at[i] = low[i] + up;
            }
            sum += weight * f64::from(self.values[(at[2] * self.size[1] + at[1]) * self.size[0] + at[0]]);
        }
        sum
    }

    /// Returns the number of cells along each axis of the cube [0, 1]³.
    fn cells(&self) -> DVec3 {
        DVec3::from_array(self.size.map(|n| (n - 1) as f64))
    }

    /// Returns the gradient in the cube's coordinates at `p`, from the cells with index `cell`.
    fn gradient(&self, p: DVec3, cell: DVec3) -> DVec3 {
        let slope = |i: usize| {
            let [mut a, mut b] = [p, p];
            (a[i], b[i]) = (cell[i], cell[i] + 1.0);
            self.at(b) - self.at(a)
        };
        DVec3::new(slope(0), slope(1), slope(2)) * self.cells()
    }

    fn smooth(&self, p: DVec3) -> DVec3 {
        let high = p.round();
        let weight = p - high + 0.5;
        let mut sum = DVec3::ZERO;
        for corner in 0..8 {
            let (mut w, mut cell) = (1.0, high);
            for i in 0..3 {
                // Below the first cell, the first cell has the full weight.
                let alone = high[i] < 0.5;
                let up = corner >> i & 1 == 1;
                w *= match (up, alone) {
                    (true, true) => 1.0,
                    (false, true) => 0.0,
                    (true, false) => weight[i],
                    (false, false) => 1.0 - weight[i],
                };
                cell[i] -= f64::from(u8::from(!up));
            }
            if w > 0.0 {
                sum += self.gradient(p, cell).normalize_or_zero() * w;
            }
        }
        sum
    }

    /// Returns the surface with `parts` subdivisions per cell and axis, or `None` if the surface has too many
    /// triangles.
    fn surface(&self, parts: usize, normals: Normals) -> Option<Surface> {
        let mut out = Surface { mesh: Mesh::default(), deviation: 0.0 };
        let [nx, ny, nz] = self.size.map(|n| n - 1);
        let mut known = HashMap::new();
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let corner = |i: usize| {
                        let at = [x + (i & 1), y + (i >> 1 & 1), z + (i >> 2)];
                        self.values[(at[2] * self.size[1] + at[1]) * self.size[0] + at[0]] < 0.0
                    };
                    if (1..8).all(|i| corner(i) == corner(0)) {
                        continue;
                    }
                    if normals == Normals::Analytic {
                        known.clear();
                    }
                    self.cell([x, y, z], parts, normals, &mut known, &mut out);
                    if out.mesh.indices.len() > MOST {
                        return None;
                    }
                }
            }
        }
        Some(out)
    }

    fn cell(
        &self,
        cell: [usize; 3],
        parts: usize,
        normals: Normals,
        known: &mut HashMap<[[usize; 3]; 2], u32>,
        out: &mut Surface,
    ) {
        /// Axis orders of the six tetrahedra.
        const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        let first = DVec3::from_array(cell.map(|i| i as f64));
        let place = |at: [usize; 3]| DVec3::from_array(at.map(|i| i as f64 / parts as f64));
        for part in 0..parts * parts * parts {
            let offset = [part % parts, part / parts % parts, part / parts / parts];
            let low = [0, 1, 2].map(|i| cell[i] * parts + offset[i]);
            for order in ORDERS {
                let mut corners = [low; 4];
                for (step, axis) in order.into_iter().enumerate() {
                    (step + 1..4).for_each(|later| corners[later][axis] += 1);
                }
                let (inside, outside): (Vec<[usize; 3]>, Vec<_>) =
                    corners.into_iter().partition(|c| self.at(place(*c)) < 0.0);
                let mut vertex = |a: [usize; 3], b: [usize; 3]| {
                    *known.entry([a, b]).or_insert_with(|| {
                        let [mut a, mut b] = [place(a), place(b)];
                        for _ in 0..30 {
                            let middle = (a + b) / 2.0;
                            *(if self.at(middle) < 0.0 { &mut a } else { &mut b }) = middle;
                        }
                        let p = (a + b) / 2.0;
                        let normal = match normals {
                            Normals::Analytic => self.gradient(p, first),
                            Normals::Smooth => self.smooth(p),
                        };
                        let normal = normal
                            .try_normalize()
                            .unwrap_or_else(|| (self.gradient(p, p.floor())).normalize_or(DVec3::Z));
                        let mesh = &mut out.mesh;
                        mesh.positions.push((p / self.cells()).as_vec3());
                        mesh.normals.push(normal.as_vec3());
                        mesh.uvs.push(UV);
                        (mesh.positions.len() - 1) as u32
                    })
                };
                let triangles: Vec<[u32; 3]> = match (inside.as_slice(), outside.as_slice()) {
                    ([a], [p, q, r]) => vec![[vertex(*a, *p), vertex(*a, *q), vertex(*a, *r)]],
                    ([a, b, c], [p]) => vec![[vertex(*a, *p), vertex(*b, *p), vertex(*c, *p)]],
                    ([a, b], [p, q]) => {
                        let [i, j, k, l] = [vertex(*a, *p), vertex(*a, *q), vertex(*b, *q), vertex(*b, *p)];
                        vec![[i, j, k], [i, k, l]]
                    }
                    _ => vec![],
                };
                let Some((a, b)) = inside.first().zip(outside.first()) else {
                    continue;
                };
                let outward = place(*b) - place(*a);
                for [i, j, k] in triangles {
                    let [a, b, c] =
                        [i, j, k].map(|v| out.mesh.positions[v as usize].as_dvec3() * self.cells());
                    let normal = (b - a).cross(c - a);
                    if normal == DVec3::ZERO {
                        continue;
                    }
                    let turned = normal.dot(outward) < 0.0;
                    out.mesh.indices.push(if turned { [i, k, j] } else { [i, j, k] });
                    let middle = (a + b + c) / 3.0;
                    let slope = (self.gradient(middle, first) / self.cells()).length();
                    let off = (self.at(middle).abs() / slope).min(1.0 / parts as f64);
                    out.deviation = out.deviation.max(off);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve_tests::measures;

    fn vol(size: [usize; 3], distance: impl Fn(DVec3) -> f64) -> Vol {
        let mut values = vec![];
        for z in 0..size[2] {
            for y in 0..size[1] {
                for x in 0..size[0] {
                    let p = DVec3::new(x as f64, y as f64, z as f64);
                    values.push(distance(p / DVec3::from_array(size.map(|n| (n - 1) as f64))) as f32);
                }
            }
        }
        Vol { size, channels: 1, bbox: [[0.0; 3], [1.0; 3]], values }
    }

    #[test]
    fn a_sphere_has_its_radius_area_and_volume() {
        let sphere = vol([33, 41, 37], |p| p.distance(DVec3::splat(0.5)) - 0.3);
        for normals in [Normals::Smooth, Normals::Analytic] {
            let found = surface(&sphere, normals).unwrap();
            let [area, volume] = measures(&found.mesh);
            assert!((area / (4.0 * std::f64::consts::PI * 0.09) - 1.0).abs() < 5e-3, "{area}");
            assert!((volume / (4.0 / 3.0 * std::f64::consts::PI * 0.027) - 1.0).abs() < 5e-3, "{volume}");
            assert!(found.deviation < NEAR);
            for (p, n) in found.mesh.positions.iter().zip(&found.mesh.normals) {
                let from = p.as_dvec3() - 0.5;
                assert!((from.length() - 0.3).abs() < 1e-3);
                assert!(from.normalize().dot(n.as_dvec3()) > 0.99, "{p} {n}");
            }
        }
    }

    /// Tests that the mesh of a plane within one cell reaches the grid's edges.
    #[test]
    fn a_plane_reaches_the_edges_of_its_grid() {
        let found = surface(&vol([2, 2, 2], |p| p.z - 0.25), Normals::Smooth).unwrap();
        let [area, volume] = measures(&found.mesh);
        assert!((area - 1.0).abs() < 1e-6 && (volume - 0.25 / 3.0).abs() < 1e-6);
        assert!(found.mesh.normals.iter().all(|n| n.z > 0.9999));
    }

    /// Tests a cell whose corners have alternating signs. The surface in the cell is a saddle without flat
    /// parts, so the cell must be subdivided.
    #[test]
    fn a_saddle_in_one_cell_is_subdivided() {
        let saddle = vol([2, 2, 2], |p| (p.x - 0.5) * (p.y - 0.5) + 0.5 * (p.z - 0.5));
        let found = surface(&saddle, Normals::Analytic).unwrap();
        assert!(found.deviation < 0.03 && found.mesh.indices.len() > 12, "{}", found.deviation);
        for p in &found.mesh.positions {
            let p = p.as_dvec3();
            assert!(((p.x - 0.5) * (p.y - 0.5) + 0.5 * (p.z - 0.5)).abs() < 1e-6);
        }
    }

    #[test]
    fn grids_without_a_surface_are_refused() {
        let full = vol([3, 3, 3], |_| 1.0);
        assert!(surface(&full, Normals::Smooth).unwrap_err().to_string().contains("sign"));
        let flat = Vol { size: [27, 1, 1], ..full.clone() };
        assert!(surface(&flat, Normals::Smooth).unwrap_err().to_string().contains("27 x 1 x 1"));
        let three = Vol { channels: 3, size: [3, 3, 1], ..full };
        assert!(surface(&three, Normals::Smooth).unwrap_err().to_string().contains("3 values"));
    }
}
