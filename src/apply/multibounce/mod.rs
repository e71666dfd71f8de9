//! Untangling multi-bounce light: Baek & Heide (2021), section 6.4, Fig. 13, on a disco ball among painted walls, on coins before
//! a mirror, and on a statue and a mirror before a coaxial rig.
//!
//! The paper names an element of the tensor for each kind of light. Here each is judged as a detector and as an image of the light
//! that it is said to isolate, against the renderer's labels, as it is written and with the sign that suits the training variants;
//! beside it what any element of space and polarization reaches, and what polarization, space, time or intensity alone do.

mod application;
mod coins;
mod disco_ball;
mod methods;
mod statue;

pub use application::Multibounce;
pub use coins::COINS;
pub use disco_ball::DISCO_BALL;
pub use statue::Statue;

#[cfg(test)]
mod tests;
