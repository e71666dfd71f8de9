//! Lists the category (`bsdf`, `shape`, …) of each of Mitsuba's plugins, because Python dictionaries omit the
//! category.

pub(super) fn tag(plugin: &str) -> Option<&'static str> {
    let found = PLUGINS.iter().find(|(_, names)| names.split(' ').any(|name| name == plugin));
    found.map(|(tag, _)| *tag)
}

/// XML tags, each with the names of its plugins in Mitsuba 3.9.
const PLUGINS: [(&str, &str); 14] = [
    (
        "shape",
        "obj ply serialized sphere cylinder disk rectangle cube shapegroup instance merge \
         bsplinecurve linearcurve sdfgrid ellipsoids ellipsoidsmesh",
    ),
    (
        "bsdf",
        "diffuse dielectric thindielectric roughdielectric conductor roughconductor plastic \
         roughplastic pplastic principled principledthin hair measured measured_polarized bumpmap \
         normalmap blendbsdf mask twosided null polarizer retarder circular",
    ),
    (
        "emitter",
        "area point constant envmap spot projector directional directionalarea sunsky \
         timed_sunsky volumelight",
    ),
    ("sensor", "perspective thinlens orthographic radiancemeter irradiancemeter distant batch"),
    ("film", "hdrfilm specfilm"),
    ("rfilter", "box tent gaussian mitchell catmullrom lanczos"),
    ("sampler", "independent stratified multijitter orthogonal ldsampler"),
    (
        "integrator",
        "path direct aov volpath volpathmis prb prbvolpath ptracer stokes moment depth \
         direct_projective prb_projective prb_basic",
    ),
    ("texture", "bitmap checkerboard mesh_attribute volume uniform_texture"),
    ("spectrum", "uniform regular irregular srgb d65 blackbody rawconstant"),
    ("medium", "homogeneous heterogeneous"),
    ("phase", "isotropic hg rayleigh sggx blendphase tabphase"),
    ("volume", "constvolume gridvolume"),
    ("scene", "scene"),
];
