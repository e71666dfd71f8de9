fn main() {
    for path in std::env::args().skip(1) {
        let p = std::path::Path::new(&path);
        match sunstone_import::load(p) {
            Ok(m) => {
                let (mut area, mut tris) = (0.0f64, 0);
                let mut lo = glam::DVec3::INFINITY;
                let mut hi = glam::DVec3::NEG_INFINITY;
                for part in &m.parts {
                    for t in &part.mesh.indices {
                        let [a, b, c] = t.map(|i| part.mesh.positions[i as usize].as_dvec3());
                        area += (b - a).cross(c - a).length() / 2.0;
                        tris += 1;
                        for q in [a, b, c] {
                            lo = lo.min(q);
                            hi = hi.max(q);
                        }
                    }
                }
                let uvs = m.parts.iter().filter(|p| !p.mesh.uvs.is_empty()).count();
                println!(
                    "OK\t{path}\t{}\t{tris}\t{area:.9e}\t{:?}\t{:?}\t{uvs}\t{}",
                    m.parts.len(),
                    lo.to_array(),
                    hi.to_array(),
                    m.notes.join(" | ")
                );
            }
            Err(e) => println!("ERR\t{path}\t{e}"),
        }
    }
}
