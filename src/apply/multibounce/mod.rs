//! Isolates multi-bounce light (Baek & Heide 2021, section 6.4, Fig. 13). The scenes are:
//! - a disco ball between painted walls,
//! - coins in front of a mirror,
//! - a statue and a mirror in front of a coaxial rig.
//!
//! The paper names an element of the tensor for each kind of light. This application compares each element
//! with the renderer's labels, as a detector and as an image of the isolated light. The sign of an element is
//! the paper's sign, or is learned from the training variants. One baseline is the best element of space and
//! polarization. Each of the remaining baselines uses only one of polarization, space, time and intensity.
//! Linear methods combine several elements of one or more of these dimensions.

mod coins;
mod disco_ball;
mod methods;
mod statue;

pub(crate) use coins::coins;
pub(crate) use disco_ball::disco_ball;
pub(crate) use statue::statue;

#[cfg(test)]
mod tests;
