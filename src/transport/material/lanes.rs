//! The wavelengths that a path carries, each in one lane of a [`Spectral`].

use optics::sampling::stream::Stream;
use optics::spectrum::Spectral;

/// The set of wavelength lanes that a path still carries. Dispersion reduces the set to one lane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lanes {
    /// Bit mask of the live lanes. Bit i is set if lane i is live.
    pub mask: u8,
}

impl Lanes {
    /// Returns the set of the first `n` lanes.
    #[inline]
    pub fn first(n: usize) -> Self {
        Self { mask: ((1_u16 << n) - 1) as u8 }
    }

    /// Returns the number of live lanes.
    #[inline]
    pub fn count(self) -> u32 {
        self.mask.count_ones()
    }

    /// Returns 1 in live lanes and 0 in the other lanes.
    #[inline]
    pub fn ones(self) -> Spectral {
        Spectral::new([0, 1, 2, 3].map(|i| f32::from(self.mask >> i & 1)))
    }

    /// Returns the index of the `k`-th live lane, counted from 0.
    #[inline]
    pub fn nth(self, k: u32) -> usize {
        let mut left = k;
        (0..4)
            .find(|i| {
                let alive = self.mask >> i & 1 == 1;
                let found = alive && left == 0;
                if alive && left > 0 {
                    left -= 1;
                }
                found
            })
            .unwrap_or(0)
    }

    /// Returns the mean of a value over the live lanes.
    #[inline]
    pub fn mean(self, value: Spectral) -> f32 {
        let values = value.to_array();
        let alive = self.count().max(1);
        (0..alive).map(|k| values[self.nth(k)]).sum::<f32>() / alive as f32
    }

    /// Samples one of the live lanes uniformly.
    #[inline]
    pub fn draw(self, stream: &mut Stream) -> usize {
        let alive = self.count().max(1);
        self.nth(((stream.uniform() * alive as f32) as u32).min(alive - 1))
    }

    /// Samples one live lane uniformly and removes the other lanes. Returns the lane, and the weight with
    /// which this lane represents all lanes (Wilkie et al. 2014, "Hero wavelength spectral sampling").
    #[inline]
    pub fn choose_hero(&mut self, stream: &mut Stream) -> (usize, Spectral) {
        let alive = self.count().max(1);
        let lane = self.draw(stream);
        self.mask = 1 << lane;
        let mut weight = [0.0; 4];
        weight[lane] = alive as f32;
        (lane, Spectral::new(weight))
    }
}

/// Returns true if the first `count` lanes of a value are not all equal.
pub fn varies(value: Spectral, count: usize) -> bool {
    let lanes = value.to_array();
    lanes[1..count].iter().any(|l| *l != lanes[0])
}
