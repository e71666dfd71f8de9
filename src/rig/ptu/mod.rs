//! PicoQuant's `.ptu` files of time-tagged photons: read as a stream, written, and turned into histograms.
