//! Polarizers, retarders, beamsplitter and mirrors: their imperfections from captures of known samples.
