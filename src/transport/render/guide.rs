//! Where light comes from in a medium, and where it is wanted: walks turn towards there more often than light does.
//!
//! Where particles scatter mostly forward, most of what a camera gets from a lit medium took small turns, one large turn, and
//! small turns again. A walk makes small turns by itself; if it left the large one to chance too, or to a line between the
//! points of two walks, hardly any path would have it, and those few would count for all. So a walk that comes to a particle
//! goes on, with probability [`SHARE`], not as light that came along its own ray, but as light that came along the ray
//! *from the other end*: from the camera's side it turns toward the emitters, give or take an angle that the phase function has
//! for a small turn, and the small turn that then leads to the emitter is as likely as the phase function says. The peaks
//! of both cancel, and the large turn is evaluated, which has none. (Directions toward a light that is blurred by
//! scattering: Georgiev et al. 2013, Herholz et al. 2019, of which this is the simplest case.)
//!
//! Walks *lean*, too. Light of many small turns comes round by degrees, and reaches the other end where it happens to run toward it,
//! which of all directions few do. So of the two directions that lie opposite each other across the way on which a walk came to a
//! particle, as likely as each other by the phase function, the one that is more toward the target is taken more often ([`Guide::lean`]).
//!
//! Any target is right, since densities say what was done; [`super::apparent`] finds good ones.

use super::state::From;
use crate::medium::Media;
use arrayvec::ArrayVec;
use glam::Vec3A;
use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;
use std::f32::consts::PI;

/// Walks at a point that turn toward a target. A path has dozens of points at which light may take its large turn, so walks that
/// turned more often would hardly ever get to the later ones (measured in milk: 0.05 to 0.1 is best, 0.25 as bad as none).
const SHARE: f32 = 0.06;

/// How much more often than by chance walks lean toward a target, at most: below 1, so that they may go anywhere.
const LEAN: f32 = 0.9;

/// Events in which a walk turns and leans; then it goes on as particles send it. What it counts for is a product of as many factors, whose
/// tail grows with their number beyond what parting makes up for: of a lossless slab of depth 32 and asymmetry 0.82, whose light meets
/// hundreds of particles, walks that were guided all the way showed 5 to 14 % less than there is in up to 36,000 samples, with errors that
/// said 2 %. (The milky tank's paths have no more than 49.)
pub(super) const MOST_EVENTS: u32 = 48;

/// Targets in a medium for the walks of one side.
const MOST: usize = 4;

type Targets = ArrayVec<Vec3A, MOST>;

/// The targets of every medium, by its number: of walks from the camera and of walks from the light.
#[derive(Clone, Debug, Default)]
pub(super) struct Guide {
    targets: Vec<[Targets; 2]>,
}

impl Guide {
    /// Of media without targets.
    pub fn none(media: &Media) -> Self {
        Self {
            targets: vec![[Targets::new(), Targets::new()]; media.list.len()],
        }
    }

    /// Adds a place toward which walks in a medium turn, while there is room for it.
    pub fn add(&mut self, medium: u32, from: From, place: Vec3A) {
        if let Some(targets) = self.targets.get_mut(medium as usize) {
            // Further emitters are found without.
            let _ = targets[from as usize].try_push(place);
        }
    }

    /// True if walks of both sides turn in some medium.
    pub fn turns_both(&self) -> bool {
        self.targets.iter().any(|t| t.iter().all(|side| !side.is_empty()))
    }

    /// Targets of a walk in a medium.
    #[inline]
    fn targets(&self, id: u32, from: From) -> &[Vec3A] {
        self.targets.get(id as usize).map_or(&[], |t| &t[from as usize])
    }

    /// True if walks turn anywhere in a medium.
    #[inline]
    pub fn turns(&self, medium: u32, from: From) -> bool {
        !self.targets(medium, from).is_empty()
    }

    /// Decides whether a walk turns toward a target: the direction that it would then have come from, had it come straight from
    /// the other end.
    #[inline]
    pub fn turn(&self, at: At, stream: &mut Stream) -> Option<Vec3A> {
        let targets = self.targets(at.medium, at.from);
        if targets.is_empty() {
            return None;
        }
        let u = stream.uniform() * (1.0 / SHARE);
        if u >= 1.0 {
            return None;
        }
        let n = ((u * targets.len() as f32) as usize).min(targets.len() - 1);
        (at.p - targets[n]).try_normalize()
    }

    /// How a walk that came from direction `back` to a particle leans toward its targets.
    #[inline]
    pub fn lean(&self, at: At, back: Vec3A, to: Vec3A) -> Lean {
        let targets = self.targets(at.medium, at.from);
        if targets.is_empty() {
            return Lean {
                partner: to,
                factor: 1.0,
            };
        }
        // Of unit length anew: what rounding adds would grow threefold with every particle.
        let partner = (back * (2.0 * back.dot(to)) - to).normalize();
        let mut pull = Vec3A::ZERO;
        for target in targets {
            pull += (*target - at.p).normalize_or_zero();
        }
        // The mean of directions: what pulls two ways pulls less.
        let more = pull.dot(to - partner) * (0.5 * LEAN / targets.len() as f32);
        Lean {
            partner,
            factor: 1.0 + more,
        }
    }

    /// What turns do to the density of the direction `to`.
    #[inline]
    pub fn toward(&self, media: &Media, at: At, to: Vec3A) -> Toward {
        let targets = self.targets(at.medium, at.from);
        if targets.is_empty() {
            return Toward {
                straight: 1.0,
                turned: Spectral::ZERO,
                hopes: Spectral::ONE,
            };
        }
        let mut toward = Spectral::ZERO;
        let mut missed = 0.0;
        for target in targets {
            match (at.p - *target).try_normalize() {
                Some(wo) => toward += media.densities_toward(at.medium, wo, to),
                None => missed += 1.0,
            }
        }
        let all = targets.len() as f32;
        toward *= Spectral::splat(1.0 / all);
        Toward {
            straight: 1.0 - SHARE * (1.0 - missed / all),
            turned: toward * Spectral::splat(SHARE),
            hopes: Spectral::ONE + toward * Spectral::splat(4.0 * PI),
        }
    }
}

/// The direction opposite another across the way on which a walk came, and how much likelier than by the phase function a
/// walk that does not turn goes along that other: between 0 and 2, its partner 2 less that.
#[derive(Clone, Copy)]
pub(super) struct Lean {
    pub partner: Vec3A,
    pub factor: f32,
}

/// A direction that walks may turn to.
#[derive(Clone, Copy)]
pub(super) struct Toward {
    /// How likely a walk does not turn.
    straight: f32,
    /// Density by lane per steradian with which walks turn there.
    turned: Spectral,
    /// How much more light may be hoped for there than from elsewhere, as a factor, by lane.
    pub hopes: Spectral,
}

impl Toward {
    /// Densities by lane per steradian of walks that, if they do not turn, go there with the density `own`.
    #[inline]
    pub fn densities(&self, own: Spectral) -> Spectral {
        own * Spectral::splat(self.straight) + self.turned
    }
}

/// Where a walk has come to in a medium.
#[derive(Clone, Copy)]
pub(super) struct At {
    pub medium: u32,
    pub p: Vec3A,
    /// The end that the walk began at.
    pub from: From,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medium::bulk::{Bulk, Optics, PhaseOptics};
    use crate::medium::henyey_greenstein::HenyeyGreenstein;
    use std::f32::consts::TAU;

    const P: Vec3A = Vec3A::new(0.1, -0.2, 0.3);

    /// A medium that scatters forward, and walks from the camera that turn toward two places.
    fn guided() -> (Media, Guide) {
        let mut media = Media::default();
        let bulk = Bulk {
            absorption: 0.0,
            scattering: 1.0,
            index: 1.0,
            asymmetry: 0.7,
            c_sca: 0.0,
            c_abs: 0.0,
        };
        media.push(&Optics {
            bulk: vec![bulk],
            phase: PhaseOptics::HenyeyGreenstein(HenyeyGreenstein::new(Spectral::splat(0.7), 0.0, 0.0)),
        });
        let mut guide = Guide::none(&media);
        guide.add(0, From::Camera, Vec3A::new(2.0, 1.0, 0.0));
        guide.add(0, From::Camera, Vec3A::new(-1.0, 0.0, 3.0));
        (media, guide)
    }

    /// chi squared per degree of freedom of directions that are drawn, against densities, on a grid of cosθ and φ, and the integral
    /// of these.
    fn chi2(
        draw: impl Fn(&Guide, &Media, At, &mut Stream) -> Vec3A,
        density: impl Fn(&Guide, &Media, At, Vec3A) -> f32,
    ) -> (f64, f64) {
        const N: usize = 400_000;
        const ROWS: usize = 16;
        const COLUMNS: usize = 32;
        const SUB: usize = 8;
        let (media, guide) = guided();
        let at = At {
            medium: 0,
            p: P,
            from: From::Camera,
        };
        let mut stream = Stream::new(11, 0, 0);
        let mut counts = vec![0.0_f64; ROWS * COLUMNS];
        for _ in 0..N {
            let w = draw(&guide, &media, at, &mut stream);
            assert!((w.length() - 1.0).abs() < 1e-4);
            let row = ((w.z + 1.0) / 2.0 * ROWS as f32) as usize;
            let column = (w.y.atan2(w.x) / TAU).rem_euclid(1.0) * COLUMNS as f32;
            counts[row.min(ROWS - 1) * COLUMNS + (column as usize).min(COLUMNS - 1)] += 1.0;
        }
        let (mut chi, mut all) = (0.0, 0.0);
        let cell = f64::from(2.0 * TAU) / (ROWS * COLUMNS * SUB * SUB) as f64;
        for (k, count) in counts.iter().enumerate() {
            let mut expected = 0.0;
            for j in 0..SUB * SUB {
                let of = |whole: usize, part: usize| (whole * SUB + part) as f32 + 0.5;
                let z = -1.0 + 2.0 * of(k / COLUMNS, j / SUB) / (ROWS * SUB) as f32;
                let phi = TAU * of(k % COLUMNS, j % SUB) / (COLUMNS * SUB) as f32;
                let r = (1.0 - z * z).sqrt();
                let w = Vec3A::new(r * phi.cos(), r * phi.sin(), z);
                expected += f64::from(density(&guide, &media, at, w)) * cell;
            }
            all += expected;
            expected *= N as f64;
            chi += (count - expected).powi(2) / expected;
        }
        (chi / (ROWS * COLUMNS) as f64, all)
    }

    /// Directions have the density that is said of them: 5 sigma of chi squared over 512 cells of 400,000 samples; with no
    /// word of turns they have not.
    #[test]
    fn turns_have_their_density() {
        let back = Vec3A::new(0.6, 0.0, 0.8);
        let draw = |guide: &Guide, media: &Media, at, stream: &mut Stream| {
            let back = guide.turn(at, stream).unwrap_or(back);
            media.sample_lane(0, back, 0, stream).0
        };
        let own = |media: &Media, w| media.densities_toward(0, back, w);
        let most = 1.0 + 5.0 * (2.0_f64 / 512.0).sqrt();
        let (chi, all) = chi2(draw, |guide, media, at, w| {
            guide.toward(media, at, w).densities(own(media, w)).to_array()[0]
        });
        assert!(chi < most, "{chi}");
        assert!((all - 1.0).abs() < 2e-3, "{all}");
        let (chi, _) = chi2(draw, |_, media, _, w| own(media, w).to_array()[0]);
        assert!(chi > 2.0 * most, "{chi}");
    }

    /// Of the directions that walks draw, those that lean have the density that is said of them, by the same measure; with no word of
    /// that they have not, nor with a lean a quarter weaker.
    #[test]
    fn leaning_has_its_density() {
        let back = Vec3A::new(0.6, 0.0, 0.8);
        let draw = |guide: &Guide, media: &Media, at, stream: &mut Stream| {
            let to = media.sample_lane(0, back, 0, stream).0;
            let lean = guide.lean(at, back, to);
            if 2.0 * stream.uniform() < lean.factor {
                to
            } else {
                lean.partner
            }
        };
        let own = |media: &Media, w| media.densities_toward(0, back, w).to_array()[0];
        let chi = |share: f32| {
            chi2(draw, |guide, media, at, w| {
                own(media, w) * (1.0 + share * (guide.lean(at, back, w).factor - 1.0))
            })
        };
        let most = 1.0 + 5.0 * (2.0_f64 / 512.0).sqrt();
        let (chi_own, all) = chi(1.0);
        assert!(chi_own < most, "{chi_own}");
        assert!((all - 1.0).abs() < 2e-3, "{all}");
        for share in [0.0, 0.75] {
            assert!(chi(share).0 > most, "{share}: {}", chi(share).0);
        }
    }

    /// Walks from the other end, those in other media, and those at a target have the density of the medium alone.
    #[test]
    fn others_do_not_turn() {
        let (media, guide) = guided();
        let of = |medium, p, from| At { medium, p, from };
        let (to, own) = (Vec3A::Z, Spectral::splat(0.3));
        for at in [of(0, P, From::Light), of(7, P, From::Camera)] {
            assert!(!guide.turns(at.medium, at.from));
            assert_eq!(guide.lean(at, Vec3A::X, to).factor, 1.0);
            let toward = guide.toward(&media, at, to);
            let (density, hope) = (toward.densities(own), toward.hopes);
            assert_eq!([density.to_array(), hope.to_array()], [own.to_array(), [1.0; 4]]);
        }
        let mut alone = Guide::none(&media);
        alone.add(0, From::Camera, P);
        let density = alone.toward(&media, of(0, P, From::Camera), to).densities(own);
        assert_eq!(density.to_array(), own.to_array());
    }
}
