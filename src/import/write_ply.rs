//! Writes meshes as binary little-endian PLY files (G. Turk, "The PLY polygon file format", 1994).

use transport::geometry::mesh::Mesh;

/// Returns a PLY file with positions and, if present, normals and texture coordinates as f32. Values are not
/// modified.
pub fn write(mesh: &Mesh) -> Vec<u8> {
    let mut head = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n",
        mesh.positions.len()
    );
    if !mesh.normals.is_empty() {
        head += "property float nx\nproperty float ny\nproperty float nz\n";
    }
    if !mesh.uvs.is_empty() {
        head += "property float u\nproperty float v\n";
    }
    head +=
        &format!("element face {}\nproperty list uchar int vertex_indices\nend_header\n", mesh.indices.len());
    let mut out = head.into_bytes();
    let mut put = |values: &[f32]| values.iter().for_each(|v| out.extend(v.to_le_bytes()));
    for (i, p) in mesh.positions.iter().enumerate() {
        put(&p.to_array());
        if let Some(n) = mesh.normals.get(i) {
            put(&n.to_array());
        }
        if let Some(uv) = mesh.uvs.get(i) {
            put(&uv.to_array());
        }
    }
    for corners in &mesh.indices {
        out.push(3);
        corners.iter().for_each(|i| out.extend(i.to_le_bytes()));
    }
    out
}
