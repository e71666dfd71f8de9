//! Counter-based random streams: one for each camera sample, keyed by (seed, pixel, sample).
//!
//! Without stratification, the samples of a pixel are independent. With stratification, groups of samples are
//! independent. The first random numbers of a group's samples are in the strata of nets ([`super::nets`]),
//! which are selected at random for every group. The variance of the mean is estimated without bias from the
//! independent samples or groups. Error estimates are therefore valid for any number of samples, and renders
//! with different seeds merge exactly. No state is shared, so results do not depend on threads, tiles or
//! resumption.

use super::mix::mix;
use super::nets::{MOST_BITS, Nets, POINTS, nets};
use rand_core::{Rng, TryRng};
use rand_pcg::Pcg32;
use std::convert::Infallible;

/// The random stream of one camera sample.
#[derive(Clone, Debug)]
pub struct Stream {
    random: Pcg32,
    strata: Strata,
}

/// State of the stratified random numbers.
#[derive(Clone, Debug)]
struct Strata {
    nets: &'static Nets,
    /// Key of the sample's group.
    key: u64,
    /// Index of the sample in its group of 2^bits.
    index: u32,
    bits: u32,
    /// Index after the last stratified number. All numbers from [`Self::next`] up to this index are
    /// stratified. The index is 0 for an unstratified sample.
    end: u32,
    next: u32,
}

/// Empty nets for unstratified samples.
static NO_NETS: Nets = [0; POINTS];

/// Number of stratified random numbers per vertex of a path.
const PER_VERTEX: u32 = 8;
/// Number of vertices with stratified random numbers. All further numbers are independent, because
/// stratification has no effect after several random vertices.
const VERTICES: u32 = 3;

/// The number of samples of a pixel that are stratified together: a power of two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Group {
    bits: u32,
}

impl Group {
    /// Groups of a single sample, so that samples are independent and not stratified.
    pub const ALONE: Self = Self { bits: 0 };

    /// Returns the largest group, up to 64 samples, that divides `samples` into at least `replicates` groups.
    pub fn of(samples: u32, replicates: u32) -> Self {
        let fits = |bits: u32| samples.is_multiple_of(1 << bits) && samples >> bits >= replicates;
        Self { bits: (0..=MOST_BITS).rev().find(|bits| fits(*bits)).unwrap_or(0) }
    }

    #[inline]
    pub fn size(self) -> u32 {
        1 << self.bits
    }

    /// Returns the index of the group that contains a sample.
    #[inline]
    pub fn number(self, sample: u32) -> u32 {
        sample >> self.bits
    }
}

impl Strata {
    /// Returns 64 random bits for a pair of numbers.
    #[inline]
    fn drawn(&self, pair: u32) -> u64 {
        mix(self.key.wrapping_add(u64::from(pair).wrapping_mul(0x9e37_79b9_7f4a_7c15)))
    }

    /// Returns the digits of the sample's point in the net of a pair of numbers.
    #[inline]
    fn point(&self, drawn: u64) -> u32 {
        // Random bits select the net, permute the points, and shift both coordinates.
        let at = (drawn as usize & (POINTS - 1)) ^ self.index as usize;
        u32::from(self.nets[at]) ^ (drawn >> 32) as u32
    }

    /// Returns a uniform random number in the stratum that one byte of a point selects.
    #[inline]
    fn within(&self, byte: u32, raw: u32) -> u32 {
        byte << (32 - self.bits) | raw >> self.bits
    }

    #[inline]
    fn one(&mut self, raw: u32) -> u32 {
        let point = self.point(self.drawn(self.next / 2));
        let byte = point >> (8 * (self.next & 1));
        self.next += 1;
        self.within(byte, raw)
    }

    #[inline]
    fn two(&mut self, raw: [u32; 2]) -> [u32; 2] {
        let point = self.point(self.drawn(self.next / 2));
        self.next += 2;
        [self.within(point, raw[0]), self.within(point >> 8, raw[1])]
    }
}

#[inline]
fn unit(raw: u32) -> f32 {
    (raw >> 8) as f32 * (1.0 / 16_777_216.0)
}

impl Stream {
    /// Returns the stream of sample `sample` of pixel `pixel` under `seed`.
    #[inline]
    pub fn new(seed: u64, pixel: u32, sample: u32) -> Self {
        let key = mix(seed.wrapping_add(0x9e37_79b9_7f4a_7c15));
        let counter = (u64::from(pixel) << 32) | u64::from(sample);
        let state = mix(counter ^ key);
        Self {
            random: Pcg32::new(state, mix(state ^ key)),
            strata: Strata { nets: &NO_NETS, key: 0, index: 0, bits: 0, end: 0, next: 0 },
        }
    }

    /// Returns the stream of a sample whose first numbers are stratified over the sample's group. The
    /// stratified numbers are the first two numbers, and the first `PER_VERTEX` numbers after a call of
    /// [`Self::vertex`] for each of the first `VERTICES` vertices.
    #[inline]
    pub fn stratified(seed: u64, pixel: u32, sample: u32, group: Group) -> Self {
        let mut stream = Self::new(seed, pixel, sample);
        if group.bits > 0 {
            // This constant differs from that in [`Self::new`], so that the group's key is independent of
            // the keys of streams.
            let key = mix(seed.wrapping_add(0x3c79_ac49_2ba7_b653)) ^ (u64::from(pixel) << 32);
            stream.strata = Strata {
                nets: nets(group.bits),
                key: mix(key ^ u64::from(group.number(sample))),
                index: sample & (group.size() - 1),
                bits: group.bits,
                next: 0,
                end: 2,
            };
        }
        stream
    }

    /// Returns an independent stream, keyed by the next random numbers of this stream.
    #[inline]
    pub fn fork(&mut self) -> Self {
        let [a, b, c, d] = [(); 4].map(|()| self.random.next_u32());
        Self::new(u64::from(a) << 32 | u64::from(b), c, d)
    }

    /// Moves to the stratified random numbers of path vertex number `vertex`, counted from 0.
    #[inline]
    pub fn vertex(&mut self, vertex: u32) {
        let strata = &mut self.strata;
        strata.next = 2 + PER_VERTEX * vertex;
        let stratified = strata.bits > 0 && vertex < VERTICES;
        strata.end = if stratified { strata.next + PER_VERTEX } else { 0 };
    }

    /// Returns a uniform random number in [0, 1).
    #[inline]
    pub fn uniform(&mut self) -> f32 {
        let raw = self.random.next_u32();
        if self.strata.next < self.strata.end {
            return unit(self.strata.one(raw));
        }
        unit(raw)
    }

    /// Returns two independent uniform random numbers in [0, 1). In a stratified stream, the two numbers are
    /// from the same net.
    #[inline]
    pub fn uniform2(&mut self) -> [f32; 2] {
        let raw = [self.random.next_u32(), self.random.next_u32()];
        let strata = &mut self.strata;
        // Skip a number at an odd position, so that both numbers are from one net.
        if strata.next < strata.end {
            strata.next += strata.next & 1;
            if strata.next < strata.end {
                return strata.two(raw).map(unit);
            }
        }
        raw.map(unit)
    }
}

/// Provides random bits for distributions of other crates.
impl TryRng for Stream {
    type Error = Infallible;

    #[inline]
    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        self.random.try_next_u32()
    }

    #[inline]
    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        self.random.try_next_u64()
    }

    #[inline]
    fn try_fill_bytes(&mut self, out: &mut [u8]) -> Result<(), Infallible> {
        self.random.try_fill_bytes(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verifies that forks of equal streams are equal, and independent of the further numbers of the original
    /// stream. The covariance of 100,000 pairs of numbers (one from each stream) is 0 within 5 sigma. A
    /// cloned stream would have a covariance of 1/12.
    #[test]
    fn forks_are_independent() {
        const N: u32 = 100_000;
        let covariance = |fork: fn(&mut Stream) -> Stream| {
            let mut stream = Stream::new(5, 1, 2);
            let mut other = fork(&mut stream);
            let mut pair = || (f64::from(stream.uniform()) - 0.5) * (f64::from(other.uniform()) - 0.5);
            (0..N).map(|_| pair()).sum::<f64>() / f64::from(N)
        };
        let most = 5.0 / 12.0 / f64::from(N).sqrt();
        assert!(covariance(Stream::fork).abs() < most);
        assert!(covariance(|stream| stream.clone()) > 10.0 * most);
        let [mut a, mut b] = [Stream::new(5, 1, 2), Stream::new(5, 1, 2)];
        assert_eq!(a.fork().uniform(), b.fork().uniform());
        assert_ne!(a.fork().uniform(), a.uniform());
    }

    /// Verifies that the first numbers of neighbouring pixels and samples are uniform and uncorrelated (5
    /// sigma).
    #[test]
    fn neighbouring_streams_are_independent() {
        let n = 400_u32;
        let (mut sum, mut dx, mut dy) = (0.0, 0.0, 0.0);
        let f = |p, s| f64::from(Stream::new(7, p, s).uniform()) - 0.5;
        for p in 0..n {
            for s in 0..n {
                let a = f(p, s);
                sum += a;
                dx += a * f(p + 1, s);
                dy += a * f(p, s + 1);
            }
        }
        let m = f64::from(n * n);
        assert!((sum / m).abs() < 5.0 * (1.0 / 12.0 / m).sqrt());
        assert!((dx / m).abs() < 5.0 / 12.0 / m.sqrt());
        assert!((dy / m).abs() < 5.0 / 12.0 / m.sqrt());
    }

    #[test]
    fn seeds_differ() {
        assert_ne!(Stream::new(0, 0, 0).uniform(), Stream::new(1, 0, 0).uniform());
    }

    /// Returns the random numbers of all samples of a group. Each stratum and each box contains one sample.
    fn of_group(group: Group, seed: u64, number: u32) -> Vec<[f32; 20]> {
        let first = number * group.size();
        let draw = |sample| {
            let mut stream = Stream::stratified(seed, 3, sample, group);
            let mut out = [0.0; 20];
            [out[0], out[1]] = stream.uniform2();
            for vertex in 0..2 {
                stream.vertex(vertex);
                let at = 2 + 9 * vertex as usize;
                [out[at], out[at + 1]] = stream.uniform2();
                out[at + 2] = stream.uniform();
                // The second number of the pair is skipped.
                [out[at + 3], out[at + 4]] = stream.uniform2();
                [out[at + 5], out[at + 6]] = [stream.uniform(), stream.uniform()];
                // All further numbers are unstratified.
                [out[at + 7], out[at + 8]] = stream.uniform2();
            }
            out
        };
        (first..first + group.size()).map(draw).collect()
    }

    #[test]
    fn groups_have_a_sample_in_every_stratum() {
        for bits in 1..=MOST_BITS {
            let group = Group { bits };
            let samples = of_group(group, 5, 7);
            let n = group.size() as f32;
            let strata = |k: usize| {
                let mut all: Vec<u32> = samples.iter().map(|s| (s[k] * n) as u32).collect();
                all.sort_unstable();
                all.into_iter().eq(0..group.size())
            };
            assert!((0..9).chain(11..18).all(strata), "{bits}");
            // 64 independent numbers almost never fall into 64 different strata.
            assert!(bits < 4 || !(strata(9) || strata(10) || strata(18)), "{bits}");
            for pair in [0, 2, 5, 11, 14] {
                for across in 0..=bits {
                    let (nx, ny) = ((1 << across) as f32, (1 << (bits - across)) as f32);
                    let place = |s: &[f32; 20]| ((s[pair] * nx) as u32, (s[pair + 1] * ny) as u32);
                    let mut boxes: Vec<_> = samples.iter().map(place).collect();
                    boxes.sort_unstable();
                    boxes.dedup();
                    assert_eq!(boxes.len(), samples.len(), "{bits} digits, pair {pair}");
                }
            }
        }
    }

    /// Verifies that all numbers are uniform, and that numbers of one sample and of consecutive groups are
    /// uncorrelated. The test evaluates the mean and all products of two deviations (5 sigma, 20,000 groups
    /// of 4).
    #[test]
    fn stratified_numbers_are_uniform_and_independent() {
        let (group, groups) = (Group { bits: 2 }, 20_000);
        let mut means = [0.0; 20];
        let mut products = vec![0.0; 400];
        let mut next = [0.0; 20];
        let mut before: Option<[f32; 20]> = None;
        for number in 0..groups {
            let samples = of_group(group, 9, number);
            let sample = samples[number as usize % 4].map(|u| u - 0.5);
            for i in 0..20 {
                means[i] += f64::from(sample[i]);
                for j in 0..i {
                    products[20 * i + j] += f64::from(sample[i] * sample[j]);
                }
                if let Some(before) = before {
                    next[i] += f64::from(before[i] * sample[i]);
                }
            }
            before = Some(sample);
        }
        let n = f64::from(groups);
        assert!(means.iter().all(|m| (m / n).abs() < 5.0 * (1.0 / 12.0 / n).sqrt()), "{means:?}");
        for p in products.iter().chain(&next) {
            assert!((p / n).abs() < 5.0 / 12.0 / n.sqrt(), "{products:?} {next:?}");
        }
    }

    /// Verifies that the mean of a product of functions of four numbers is unbiased (5 sigma of the spread
    /// between groups). For smooth functions, the variance must be less than with independent samples.
    #[test]
    fn groups_integrate_smooth_functions_better() {
        let f = |s: &[f32; 20]| f64::from((1.0 + s[0]) * (1.0 + s[1] * s[1]) + s[2] * s[11]);
        let exact = 1.5 * 4.0 / 3.0 + 0.25;
        let of = |group: Group| {
            let groups = 6400 / group.size();
            let n = f64::from(groups);
            let mean = |g| of_group(group, 2, g).iter().map(&f).sum::<f64>() / f64::from(group.size());
            let means: Vec<f64> = (0..groups).map(mean).collect();
            let all = means.iter().sum::<f64>() / n;
            let variance = means.iter().map(|m| (m - all).powi(2)).sum::<f64>() / (n - 1.0) / n;
            assert!((all - exact).abs() < 5.0 * variance.sqrt(), "{all} {exact}");
            variance
        };
        let alone = of(Group::ALONE);
        assert!(of(Group { bits: 2 }) < alone / 2.0);
        assert!(of(Group { bits: 6 }) < alone / 8.0);
    }

    #[test]
    fn groups_fit_into_the_samples() {
        let of = |samples, replicates| Group::of(samples, replicates).size();
        assert_eq!([of(1, 16), of(31, 16), of(32, 16), of(64, 16)], [1, 1, 2, 4]);
        assert_eq!([of(1000, 16), of(1024, 16), of(4096, 16), of(64, 1)], [8, 64, 64, 64]);
    }

    /// Verifies that uniform numbers are computed from the raw bits, and that every bit is set half of the
    /// time (5 sigma).
    #[test]
    fn raw_numbers_match_uniforms_and_are_unbiased() {
        let (mut a, mut b) = (Stream::new(7, 1, 2), Stream::new(7, 1, 2));
        assert_eq!(a.uniform(), (b.next_u32() >> 8) as f32 / 16_777_216.0);
        let n = 40_000;
        let mut set = [0_u32; 64];
        for _ in 0..n {
            let bits = a.next_u64();
            (0..64).for_each(|k| set[k] += (bits >> k & 1) as u32);
        }
        let off = |k: u32| (f64::from(k) / f64::from(n) - 0.5).abs() * 2.0 * f64::from(n).sqrt();
        assert!(set.iter().all(|k| off(*k) < 5.0), "{set:?}");
    }
}
