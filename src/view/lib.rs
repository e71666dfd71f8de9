//! The explorer of stores. A server on this computer answers the requests of a page in the browser: slices,
//! probes of slices, simulated captures and frames of a rig.
//!
//! The page is built from `page/` into `built/`, and is embedded in the program. All numbers come from
//! [`store::probe::Probe`], as those of the command `sunstone probe`.
//!
//! **Security.** The server listens on the loopback interface only. Every request for data needs a random
//! token, which the URL of the page contains. Requests with a foreign `Host` or `Origin` are refused, so that
//! other web pages cannot read data through the browser. A request names a store by its number, never by a
//! path.

mod answer;
mod describe;
mod error;
mod export;
mod frames;
mod image;
mod jobs;
mod open;
mod page;
mod probe;
mod progress;
mod request;
mod server;
mod service;
mod trial;

pub use error::ViewError;
pub use export::export;
pub use server::Viewer;
