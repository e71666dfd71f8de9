//! Random walks from the camera or from an emitter through surfaces and media. A walk consists of vertices
//! ([`super::vertex`]) that are joined by flights ([`super::flight`]).

use super::scattering::{Continuation, Progress, scatter_in, scatter_on};
use super::splitting::{Branch, Splitting};
use super::{End, Flight, Guide, Landing, Site, Vertex, mean_transmittance};
use crate::geometry::ray::Ray;
use crate::render::emitter_hits::{DirectionSampling, EmitterHit};
use crate::render::roulette::{Odds, survives};
use crate::render::state::{Beam, From};
use crate::scene::Scene;
use optics::polarization::chain::Chain;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// Maximum survival probability of Russian roulette. Where large particles scatter light forward, few
/// subpaths find the light, and only after dozens of events. With a lower maximum, these few subpaths would
/// have to compensate for all terminated subpaths.
const SURVIVAL: f32 = 0.99;

/// The vertices of a subpath. The first vertex is the end at which the subpath starts.
#[derive(Default)]
pub(crate) struct Walk {
    pub points: Vec<Vertex>,
    /// State of the subpath after it has left the scene, or `None` if the subpath ended in the scene.
    pub escape: Option<Escape>,
    /// The points at which the subpath hit emissive surfaces.
    pub glows: Vec<EmitterHit>,
    pub rays: u32,
    /// Index of the first vertex that the current branch does not share with earlier branches.
    pub fresh: usize,
    /// The branch that was taken at each split. There is one bit per split, and the first split is in the
    /// lowest bit.
    pub lineage: u8,
    /// Branches that have not been traced yet.
    pending: Vec<Branch>,
}

/// A subpath that has left the scene.
pub(crate) struct Escape {
    pub chain: Chain,
    /// Direction and Stokes frame of the light on which the subpath's Mueller product acts.
    pub beam: Beam,
    /// Number of earlier interactions. `label` is the path label of these interactions.
    pub interactions: u32,
    pub label: u8,
    pub chosen: DirectionSampling,
}

/// Conditions under which a subpath ends.
#[derive(Clone, Copy)]
pub(crate) struct Limits {
    pub interactions: u32,
    /// Index of the last required vertex.
    pub point: usize,
    /// True if the subpath continues after the last interaction to test whether it leaves the scene.
    pub escapes: bool,
    /// True if path labels are needed.
    pub labelled: bool,
    pub first: First,
    pub splitting: Splitting,
}

/// Condition on the first vertex under which a subpath continues.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum First {
    Anything,
    /// The vertex must redirect the subpath into a single direction. Other subpaths are discarded.
    Redirects,
    /// The vertex must not be on a Lambertian surface. At a Lambertian surface, the subpath ends.
    NotLambert,
}

impl Walk {
    /// Traces a subpath from one end. If the subpath is split, only the first branch is traced.
    pub fn run(
        &mut self,
        scene: &Scene,
        guide: &Guide,
        from: From,
        end: &End,
        stream: &mut Stream,
        limits: Limits,
    ) {
        self.points.clear();
        self.escape = None;
        self.glows.clear();
        self.rays = 0;
        (self.fresh, self.lineage) = (0, 0);
        self.pending.clear();
        let mut progress = Progress {
            flight: Flight::start(scene, from, end, stream),
            density: end.density,
            chosen: DirectionSampling::alone(end.ray.origin),
            full: end.chain.max_m00(),
            hope: 1.0,
            interactions: 0,
            labelled: limits.labelled,
            splits: 0,
        };
        self.points.push(Vertex::end(scene, end));
        while self.step(scene, guide, &mut progress, stream, limits) {
            if let [_, first] = &self.points[..]
                && match limits.first {
                    First::Anything => false,
                    First::Redirects => !first.delta,
                    First::NotLambert => first.is_lambert(scene),
                }
            {
                break;
            }
        }
        if limits.first == First::Redirects && self.points.get(1).is_some_and(|first| !first.delta) {
            self.points.truncate(1);
        }
    }

    /// Traces the next branch. Returns false if there are no more branches. Vertices before [`Self::fresh`]
    /// are shared.
    pub fn next_branch(&mut self, scene: &Scene, guide: &Guide, limits: Limits) -> bool {
        let Some(Branch { points, mut progress, lineage, mut stream }) = self.pending.pop() else {
            return false;
        };
        self.points.truncate(points);
        self.escape = None;
        self.glows.clear();
        (self.fresh, self.lineage) = (points, lineage);
        if self.depart(scene, guide, &mut progress, &mut stream, limits) {
            while self.step(scene, guide, &mut progress, &mut stream, limits) {}
        }
        true
    }

    /// Moves to the next vertex and samples a continuation. Returns false if the subpath ends.
    fn step(
        &mut self,
        scene: &Scene,
        guide: &Guide,
        progress: &mut Progress,
        stream: &mut Stream,
        limits: Limits,
    ) -> bool {
        if !self.land(scene, progress, stream, limits) {
            return false;
        }
        let left = limits.splitting.split(guide, &self.points, self.lineage, progress, stream);
        self.pending.extend(left);
        self.depart(scene, guide, progress, stream, limits)
    }

    /// Samples a continuation from the last vertex. Returns false if the subpath ends.
    fn depart(
        &mut self,
        scene: &Scene,
        guide: &Guide,
        progress: &mut Progress,
        stream: &mut Stream,
        limits: Limits,
    ) -> bool {
        // Vertices are large, so they are modified in place.
        let [.., before, point] = &mut self.points[..] else {
            unreachable!("a subpath has an endpoint and at least one vertex");
        };
        stream.vertex(progress.interactions);
        let continuation = match point.site {
            Site::Volume(id) => scatter_in(scene, guide, id, [before, point], progress, stream),
            _ => scatter_on(scene, guide, [before, point], progress, stream),
        };
        progress.interactions += 1;
        let wi = match continuation {
            Continuation::Toward(wi) => wi,
            Continuation::Straight => {
                let flight = &mut progress.flight;
                flight.settle();
                flight.state.ray.origin = scene.geometry.leave(&point.surface, flight.state.ray.dir);
                self.points.pop();
                return true;
            }
            Continuation::Nowhere => return false,
        };
        let (from, origin) = (point.at, point.leave(scene, wi));
        let last = self.points.len() > limits.point;
        if last || progress.interactions >= limits.interactions && !limits.escapes {
            return false;
        }
        let odds = Odds {
            plays: progress.interactions >= scene.settings.rr_depth,
            full: progress.full / progress.hope,
            most: SURVIVAL,
        };
        let flight = &mut progress.flight;
        if !survives(&mut flight.state.chain, odds, stream) {
            return false;
        }
        flight.state.from = from;
        flight.state.ray = Ray { origin, dir: wi };
        flight.settle();
        flight.depth = Spectral::ZERO;
        true
    }

    /// Moves to the next vertex and appends this vertex with its density. Returns false if the subpath ends
    /// before the vertex.
    fn land(&mut self, scene: &Scene, progress: &mut Progress, stream: &mut Stream, limits: Limits) -> bool {
        let Progress { flight, interactions, .. } = progress;
        let (site, surface, hit) = match flight.fly(scene, stream, &mut self.rays) {
            Landing::At(site, surface, hit) => (site, surface, hit),
            Landing::Escaped => {
                self.escape = Some(Escape {
                    chain: flight.state.chain,
                    beam: Beam { travel: -flight.state.ray.dir, frame: flight.state.frame },
                    interactions: *interactions,
                    label: flight.state.label,
                    chosen: progress.chosen,
                });
                return false;
            }
            Landing::Absorbed => return false,
        };
        if flight.end == From::Camera && site == Site::Surface && scene.lights.of(surface.material).is_some()
        {
            let state = &flight.state;
            self.glows.push(EmitterHit {
                chain: state.chain,
                beam: Beam { travel: -state.ray.dir, frame: state.frame },
                surface,
                facet: hit.and_then(|hit| scene.geometry.facet(&hit)),
                optical_m: state.optical_m,
                interactions: *interactions,
                label: state.label,
                chosen: progress.chosen,
            });
        }
        if *interactions >= limits.interactions {
            return false;
        }
        self.points.push(flight.landed(site, surface, *interactions));
        let [.., before, point] = &mut self.points[..] else {
            unreachable!("a subpath has an endpoint and at least one vertex");
        };
        let distance2 = (surface.p - before.surface.p).length_squared().max(f32::MIN_POSITIVE);
        let passed = mean_transmittance(scene, flight.depth) / distance2;
        point.forward = progress.density * passed * point.cosine(point.back);
        point.spread = passed * before.cosine(point.back);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::ray::Ray;
    use crate::material::filling::Filling;
    use crate::medium::bulk::{Bulk, Optics, PhaseOptics};
    use crate::medium::henyey_greenstein::HenyeyGreenstein;
    use crate::medium::nesting::{Boundary, Nest};
    use crate::render::subpath::vertex::End;
    use crate::render::tests::tables;
    use crate::scene::Integrator;
    use glam::Vec3A;
    use optics::polarization::chain::Chain;

    const G: f32 = 0.9;

    /// Number of scattering events per subpath.
    const LAST: usize = 36;

    /// Returns an unbounded milky medium, with guiding toward a target that is not in the initial direction.
    fn milk() -> (Scene, Guide, End) {
        let mut tables = tables(Integrator::Bidirectional, true);
        let bulk = Bulk { scattering: 1e6, index: 1.0, asymmetry: f64::from(G), ..Bulk::default() };
        tables.media.push(&Optics {
            bulk: vec![bulk; 4],
            phase: PhaseOptics::HenyeyGreenstein(HenyeyGreenstein::new(Spectral::splat(G), 0.0, 0.0)),
        });
        tables.boundaries[0] = Boundary { medium: 0, priority: 0, object: 0 };
        tables.settings.rr_depth = u32::MAX;
        let scene = Scene::new(tables);
        let mut guide = Guide::none(&scene.media);
        guide.add(0, From::Camera, Vec3A::new(0.8, 0.0, -0.6));
        let mut nest = Nest::default();
        nest.cross(&scene.boundaries, 0, true);
        let end = End {
            ray: Ray { origin: Vec3A::ZERO, dir: Vec3A::Z },
            chain: Chain::start(Spectral::ONE),
            frame: Vec3A::X,
            density: 1.0,
            filling: Filling::VACUUM,
            nest,
        };
        (scene, guide, end)
    }

    fn limits(splitting: Splitting) -> Limits {
        limits_to(LAST, splitting)
    }

    fn limits_to(point: usize, splitting: Splitting) -> Limits {
        Limits {
            interactions: u32::MAX,
            point,
            escapes: false,
            labelled: false,
            first: First::Anything,
            splitting,
        }
    }

    /// Returns the weight of a branch at a vertex, and the product of the weight and the cosine of the angle
    /// to the first direction.
    fn counts(walk: &Walk, at: usize) -> [f64; 2] {
        let Some(point) = walk.points.get(at).filter(|_| walk.fresh <= at) else {
            return [0.0; 2];
        };
        let weight = f64::from(point.chain.max_m00());
        [weight, weight * f64::from(-point.back.z)]
    }

    /// Returns the mean and the standard error of both results of [`counts`] over subpaths up to a vertex.
    /// Also returns the variance of the first result.
    fn means(walks: u32, at: usize, splitting: Splitting, guide: &Guide) -> ([(f64, f64); 2], f64) {
        let (scene, _, end) = milk();
        let (mut walk, limits) = (Walk::default(), limits_to(at, splitting));
        let (mut sum, mut square) = ([0.0; 2], [0.0; 2]);
        for n in 0..walks {
            let mut stream = Stream::new(3, n, 0);
            walk.run(&scene, guide, From::Camera, &end, &mut stream, limits);
            let mut all = counts(&walk, at);
            while walk.next_branch(&scene, guide, limits) {
                let more = counts(&walk, at);
                all = [all[0] + more[0], all[1] + more[1]];
            }
            for k in 0..2 {
                sum[k] += all[k];
                square[k] += all[k] * all[k];
            }
        }
        let n = f64::from(walks);
        let of = |k: usize| {
            let mean: f64 = sum[k] / n;
            (mean, ((square[k] / n - mean * mean) / n).sqrt())
        };
        ([of(0), of(1)], of(0).1.powi(2) * n)
    }

    /// Verifies the weights of guided subpaths without absorption, with and without splitting. After n
    /// scattering events, the mean weight must be one and the mean cosine must be gⁿ. Splitting must reduce
    /// the variance to less than half.
    #[test]
    #[ignore = "slow: tools/check --all"]
    fn walks_have_mean_weight_one_with_and_without_splitting() {
        let (_, guide, _) = milk();
        let mut variances = [0.0; 2];
        for (splitting, variance) in [Splitting::Never, Splitting::All].into_iter().zip(&mut variances) {
            let (found, spread) = means(40_000, LAST, splitting, &guide);
            *variance = spread;
            let wanted = [1.0, f64::from(G).powi(LAST as i32 - 1)];
            for ((mean, error), wanted) in found.into_iter().zip(wanted) {
                assert!(error < 0.05, "{error}");
                assert!((mean - wanted).abs() < 5.0 * error, "found {mean} +- {error}, expected {wanted}");
            }
        }
        assert!(variances[1] < 0.5 * variances[0], "{variances:?}");
    }

    /// Verifies that the mean weight is one after hundreds of scattering events. With guiding in all events,
    /// this test fails.
    #[test]
    #[ignore = "slow: tools/check --all"]
    fn long_walks_have_mean_weight_one() {
        let (_, guide, _) = milk();
        let ([(mean, error), _], _) = means(4000, 200, Splitting::All, &guide);
        println!("{mean} +- {error}");
        // With guiding in all events, the mean is 0.50 +- 0.13.
        assert!(error < 0.08, "{mean} +- {error}");
        assert!((mean - 1.0).abs() < 5.0 * error, "{mean} +- {error}");
    }

    /// Verifies that a trace along the lineage of a branch gives the vertices of the branch.
    #[test]
    fn following_a_lineage_gives_the_same_vertices() {
        let (scene, guide, end) = milk();
        let [mut walk, mut again] = [Walk::default(), Walk::default()];
        let mut branches = 0;
        for n in 0..200 {
            let start = || Stream::new(3, n, 0);
            walk.run(&scene, &guide, From::Camera, &end, &mut start(), limits(Splitting::All));
            while walk.next_branch(&scene, &guide, limits(Splitting::All)) {
                branches += 1;
                let follow = limits(Splitting::Follow(walk.lineage));
                again.run(&scene, &guide, From::Camera, &end, &mut start(), follow);
                for (k, point) in walk.points.iter().enumerate().skip(walk.fresh) {
                    let other = &again.points[k];
                    assert_eq!((point.surface.p, point.back), (other.surface.p, other.back));
                    assert_eq!(point.chain.max_m00(), other.chain.max_m00());
                }
            }
        }
        assert!(branches > 200, "{branches}");
    }
}
