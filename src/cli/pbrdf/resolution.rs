//! Parses the resolution of a table from a command line.

use std::str::FromStr;

/// Number of entries of a table along phi_d, theta_d and theta_h.
#[derive(Clone, Copy, Debug)]
pub struct Resolution(pub [usize; 3]);

impl FromStr for Resolution {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Option<Vec<usize>> = text.split('x').map(|n| n.trim().parse().ok()).collect();
        match parts.as_deref() {
            Some(&[a, b, c]) if [a, b, c].iter().all(|n| (2..=4096).contains(n)) => Ok(Self([a, b, c])),
            _ => Err("expected three numbers from 2 to 4096, such as 361x91x91".into()),
        }
    }
}
