//! The `sunstone view` command, which shows stores in the browser.

use crate::{Failure, places, print, print_path};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use sunstone::view::{ViewError, Viewer, export};

/// Explore stores in the browser: images of any element or polarization property, the time profile and the
/// Mueller matrix of a pixel, where its light came from, and light in flight.
///
/// The page is served to this computer only. The printed URL contains a token; pages without it read nothing.
/// A store that is being rendered is shown as it grows. Captures of `sunstone rig run` are shown frame by frame.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  sunstone view out/mirror_room.zarr
  sunstone view a.zarr b.zarr                        compare two renders
  sunstone view out/mirror_room.zarr --export site   write a folder that any web server can host
  sunstone view out/mirror_room.zarr --no-open --port 8000   print the URL and open no browser

On a remote computer, forward the port: ssh -L 8000:127.0.0.1:8000 HOST, then open the printed URL.")]
pub struct Arguments {
    /// Store written by `render`, `merge`, `reconstruct` or `rig run`. Repeatable.
    #[arg(required = true)]
    stores: Vec<PathBuf>,
    /// Port to listen on; 0 stands for any free port.
    #[arg(long, default_value_t = 0)]
    port: u16,
    /// Print the URL, and open no browser.
    #[arg(long)]
    no_open: bool,
    /// Write a folder with the page and copies of the stores, and start no server.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["port", "no_open"])]
    export: Option<PathBuf>,
    /// Replace an earlier export.
    #[arg(long, requires = "export")]
    force: bool,
}

pub fn run(a: &Arguments) -> Result<(), Failure> {
    if let Some(folder) = &a.export {
        places::folders(a.stores.iter().map(Some), [Some(folder)])?;
        export(&a.stores, folder, a.force).map_err(failure)?;
        return print_path(folder);
    }
    let viewer = Viewer::start(&a.stores, a.port).map_err(failure)?;
    print(viewer.url())?;
    eprintln!("press Ctrl-C to stop");
    if !a.no_open {
        open_browser(viewer.url());
    }
    viewer.wait().map_err(Failure::failed)
}

/// The explorer of a render's store. It is opened once, and serves until the process ends.
pub struct ViewOfRender {
    store: PathBuf,
    opened: OnceLock<bool>,
}

impl ViewOfRender {
    pub fn new(store: &Path) -> Self {
        Self { store: store.to_owned(), opened: OnceLock::new() }
    }

    /// Opens the explorer of the store, which must exist. Returns whether the explorer is open.
    pub fn open(&self) -> bool {
        *self.opened.get_or_init(|| match Viewer::start(std::slice::from_ref(&self.store), 0) {
            Ok(viewer) => {
                eprintln!("view: {}", viewer.url());
                open_browser(viewer.url());
                true
            }
            Err(e) => {
                eprintln!("note: the view could not start: {e}");
                false
            }
        })
    }
}

fn open_browser(url: &str) {
    if let Err(e) = open::that_detached(url) {
        eprintln!("note: no browser could be opened ({e}); open the URL yourself");
    }
}

fn failure(e: ViewError) -> Failure {
    Failure::of_system(e.is_of_system(), e)
}
