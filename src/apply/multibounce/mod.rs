//! Isolates multi-bounce light (Baek & Heide 2021, section 6.4, Fig. 13). The scenes are a disco ball between
//! painted walls, coins in front of a mirror, and a statue and a mirror in front of a coaxial rig.
//!
//! The paper names an element of the tensor for each kind of light. Here each element is tested against
//! the renderer's labels, as a detector and as an image of the isolated light. The sign is that of the
//! paper, or is learned from the training variants. Baselines are the best element of space and
//! polarization, and polarization, space, time or intensity alone.

mod coins;
mod disco_ball;
mod methods;
mod statue;

pub(crate) use coins::coins;
pub(crate) use disco_ball::disco_ball;
pub(crate) use statue::statue;

#[cfg(test)]
mod tests;
