//! Checks whether meshes are closed, reverses meshes whose normals point inward, and tests whether points are
//! inside.

use glam::{DVec3, Vec3};
use std::collections::HashMap;
use transport::geometry::mesh::Mesh;

/// Triangles of a closed surface (metres, world space) with their bounds.
pub struct Inside {
    triangles: Vec<[DVec3; 3]>,
    low: DVec3,
    high: DVec3,
}

impl Inside {
    /// Creates one inside test for the union of all `meshes`.
    pub fn new(meshes: &[&mut Mesh]) -> Self {
        let corner = |mesh: &Mesh, i: u32| mesh.positions[i as usize].as_dvec3();
        let triangles: Vec<[DVec3; 3]> =
            meshes.iter().flat_map(|m| m.indices.iter().map(|t| t.map(|i| corner(m, i)))).collect();
        let all = triangles.iter().flatten();
        let low = all.clone().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = all.copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        Self { triangles, low, high }
    }

    pub fn bounds(&self) -> (DVec3, DVec3) {
        (self.low, self.high)
    }

    /// Returns at most `most` points on the surface (centroids of triangles) in metres.
    pub fn points(&self, most: usize) -> Vec<DVec3> {
        let step = self.triangles.len().div_ceil(most.max(1)).max(1);
        let some = self.triangles.iter().step_by(step);
        some.map(|[a, b, c]| (a + b + c) / 3.0).collect()
    }

    /// Returns whether a point (metres, world space) is inside, or `None` if the point is too close to the
    /// surface to decide.
    pub fn holds(&self, p: DVec3) -> Option<bool> {
        let near = 1e-4 * (self.high - self.low).max_element();
        // Use a direction that is unlikely to be parallel to an edge.
        let dir = DVec3::new(0.5213, 0.6731, 0.5247).normalize();
        let mut crossings = 0;
        for t in &self.triangles {
            if let Some(at) = met(t, p, dir) {
                if at.abs() < near {
                    return None;
                }
                crossings += usize::from(at > 0.0);
            }
        }
        Some(crossings % 2 == 1)
    }
}

/// Vertex ids of each mesh. Vertices at the same position have the same id.
struct Welded {
    ids: Vec<Vec<u32>>,
    /// Position of each id, in metres.
    places: Vec<DVec3>,
}

impl Welded {
    /// Merges vertices within `near` (metres) of each other.
    fn new(meshes: &[&mut Mesh], near: f64) -> Self {
        let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
        let mut places: Vec<DVec3> = vec![];
        let size = 4.0 * near;
        let ids = meshes.iter().map(|mesh| {
            let list = mesh.positions.iter().map(|p| {
                let p = p.as_dvec3();
                // A vertex near the border of its cell can be stored in the next cell.
                let [low, high] = [-near, near].map(|by| ((p + by) / size).floor().as_i64vec3());
                for x in low.x..=high.x {
                    for y in low.y..=high.y {
                        for z in low.z..=high.z {
                            let known = cells.get(&[x, y, z]).into_iter().flatten();
                            let same = |id: &&u32| places[**id as usize].distance_squared(p) <= near * near;
                            if let Some(id) = known.into_iter().find(same) {
                                return *id;
                            }
                        }
                    }
                }
                let id = places.len() as u32;
                let cell = (p / size).floor().as_i64vec3();
                cells.entry(cell.to_array()).or_default().push(id);
                places.push(p);
                id
            });
            list.collect()
        });
        Self { ids: ids.collect(), places }
    }

    /// Returns the triangles of all meshes, without triangles that became degenerate by merging vertices.
    fn triangles<'a>(&'a self, meshes: &'a [&mut Mesh]) -> impl Iterator<Item = [u32; 3]> + 'a {
        let all = meshes.iter().zip(&self.ids);
        let triangles = all.flat_map(|(m, ids)| m.indices.iter().map(|t| t.map(|i| ids[i as usize])));
        triangles.filter(|[a, b, c]| a != b && b != c && c != a)
    }
}

/// Returns a message about the first fault of a surface that should be closed, or `None` if the surface is
/// closed. Vertices closer than 1e-6 times the surface's extent are merged, because coordinates at seams are
/// rounded.
pub fn fault(meshes: &[&mut Mesh]) -> Option<String> {
    let all = meshes.iter().flat_map(|m| &m.positions);
    let low = all.clone().copied().fold(Vec3::INFINITY, Vec3::min);
    let high = all.copied().fold(Vec3::NEG_INFINITY, Vec3::max);
    let near = 1e-6 * f64::from((high - low).max_element().max(f32::MIN_POSITIVE));
    let welded = Welded::new(meshes, near);
    // For each edge: the number of traversals from its lower id minus the number from its higher id, and the
    // total number of traversals.
    let mut edges: HashMap<(u32, u32), (i32, u32)> = HashMap::new();
    for [a, b, c] in welded.triangles(meshes) {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let (edge, way) = if from < to { ((from, to), 1) } else { ((to, from), -1) };
            let entry = edges.entry(edge).or_default();
            entry.0 += way;
            entry.1 += 1;
        }
    }
    let bad: Vec<_> = edges.iter().filter(|(_, (balance, _))| *balance != 0).collect();
    let (edge, (_, count)) = bad.iter().min_by_key(|(edge, _)| **edge)?;
    let point = |id: u32| format!("{:?}", welded.places[id as usize].as_vec3().to_array());
    let what = if count % 2 == 1 { "the surface is open" } else { "the triangles have inconsistent winding" };
    Some(format!(
        "{what} at {} of {} edges, for example from {} to {}",
        bad.len(),
        edges.len(),
        point(edge.0),
        point(edge.1)
    ))
}

/// Returns the bits of a position's coordinates, with -0 replaced by 0.
fn key(p: Vec3) -> [u32; 3] {
    p.to_array().map(|x| (x + 0.0).to_bits())
}

/// Reverses the components of a closed surface whose normals point inward, except cavities inside
/// other components. Returns whether any component was reversed.
pub fn turn_outward(meshes: &mut [&mut Mesh]) -> bool {
    let mut ids: HashMap<[u32; 3], usize> = HashMap::new();
    let mut parents: Vec<usize> = vec![];
    fn root(parents: &mut [usize], mut i: usize) -> usize {
        while parents[i] != i {
            parents[i] = parents[parents[i]];
            i = parents[i];
        }
        i
    }
    let mut corners: Vec<Vec<[usize; 3]>> = vec![];
    for mesh in meshes.iter() {
        let list = mesh.indices.iter().map(|t| {
            let t = t.map(|i| {
                *ids.entry(key(mesh.positions[i as usize])).or_insert_with(|| {
                    parents.push(parents.len());
                    parents.len() - 1
                })
            });
            for other in &t[1..] {
                let (a, b) = (root(&mut parents, t[0]), root(&mut parents, *other));
                parents[a] = b;
            }
            t
        });
        corners.push(list.collect());
    }
    // Signed volume and bounds of each component.
    let mut pieces: HashMap<usize, (f64, DVec3, DVec3)> = HashMap::new();
    for (mesh, list) in meshes.iter().zip(&corners) {
        for (t, ids) in mesh.indices.iter().zip(list) {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize].as_dvec3());
            let piece = pieces.entry(root(&mut parents, ids[0])).or_insert((
                0.0,
                DVec3::INFINITY,
                DVec3::NEG_INFINITY,
            ));
            piece.0 += a.dot(b.cross(c)) / 6.0;
            for p in [a, b, c] {
                (piece.1, piece.2) = (piece.1.min(p), piece.2.max(p));
            }
        }
    }
    let within = |inner: &(f64, DVec3, DVec3), outer: &(f64, DVec3, DVec3)| {
        inner.1.cmpgt(outer.1).all() && inner.2.cmplt(outer.2).all()
    };
    let inward: Vec<usize> = pieces
        .iter()
        .filter(|(_, piece)| piece.0 < 0.0 && !pieces.values().any(|p| within(piece, p)))
        .map(|(id, _)| *id)
        .collect();
    for (mesh, list) in meshes.iter_mut().zip(&corners) {
        let turned: Vec<bool> = list.iter().map(|t| inward.contains(&root(&mut parents, t[0]))).collect();
        let mut vertices = vec![false; mesh.positions.len()];
        for (t, turned) in mesh.indices.iter_mut().zip(turned) {
            if turned {
                t.iter().for_each(|i| vertices[*i as usize] = true);
                t.swap(1, 2);
            }
        }
        for (normal, turned) in mesh.normals.iter_mut().zip(vertices) {
            if turned {
                *normal = -*normal;
            }
        }
    }
    !inward.is_empty()
}

/// Returns the signed distance from `p` along `dir` to a triangle, or `None` if the line misses the triangle
/// (Möller & Trumbore 1997).
fn met([a, b, c]: &[DVec3; 3], p: DVec3, dir: DVec3) -> Option<f64> {
    let (e1, e2) = (b - a, c - a);
    let h = dir.cross(e2);
    let det = e1.dot(h);
    if det.abs() < 1e-300 {
        return None;
    }
    let s = p - a;
    let u = s.dot(h) / det;
    let q = s.cross(e1);
    let v = dir.dot(q) / det;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0).then(|| e2.dot(q) / det)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Affine3A;

    fn ball() -> Mesh {
        let mut mesh = Mesh::cube();
        mesh.normals.clear();
        mesh
    }

    #[test]
    fn a_cube_is_closed_and_a_cube_without_a_triangle_is_not() {
        let mut cube = ball();
        assert_eq!(fault(&[&mut cube]), None);
        assert!(!turn_outward(&mut [&mut cube]));
        let mut open = ball();
        open.indices.pop();
        let what = fault(&[&mut open]).expect("a hole");
        assert!(what.contains("open at 3 of"), "{what}");
        let mut wound = ball();
        wound.indices[0].swap(0, 1);
        let what = fault(&[&mut wound]).expect("a triangle the wrong way");
        assert!(what.contains("inconsistent winding"), "{what}");
    }

    #[test]
    fn inward_pieces_are_flipped_and_cavities_are_not() {
        let mut inward = ball();
        inward.indices.iter_mut().for_each(|t| t.swap(0, 1));
        assert!(turn_outward(&mut [&mut inward]));
        assert!(!turn_outward(&mut [&mut inward]), "once is enough");
        let mut hollow = ball();
        hollow.indices.iter_mut().for_each(|t| t.swap(0, 1));
        hollow.transform(&Affine3A::from_scale(Vec3::splat(0.5)));
        let before = hollow.clone();
        assert!(!turn_outward(&mut [&mut ball(), &mut hollow]));
        assert_eq!(before, hollow);
    }
}
