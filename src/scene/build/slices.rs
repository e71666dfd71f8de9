//! Converts slices of a scene file to [`Slice`]s and checks them against camera and projector.

use super::context::Context;
use super::textures;
use base::locate::{InputError, Located};
use import::picture;
use std::ops::Range;
use syntax::scene::SceneFile;
use syntax::slice::{CameraSelectFile, CoordinateFile, PolarizationFile, ProjectorSelectFile, SliceFile};
use syntax::values::TimeFile;
use tensor::axes::SliceLayout;
use tensor::slice::{Block, CameraSelect, Polarization, ProjectorAxis, ProjectorSelect, Slice, TimeSelect};
use transport::device::pinhole::Pinhole;
use transport::device::projector::Projector;

const RESERVED: [&str; 2] = ["samples", "zarr.json"];

/// Maximum number of elements of a slice: 2^40 keeps every index exact and is 4 TiB of f32.
const MAX_ELEMENTS: u128 = 1 << 40;

/// Maximum number of elements of a chunk in memory: 2^28 is 1 GiB of f32.
const MAX_CHUNK: u128 = 1 << 28;

/// Minimum width of a time bin relative to the latest time of the bins. f64 distinguishes bin centres down
/// to a relative difference of 2^-53.
const LEAST_BIN: f64 = 1e-12;

/// Maximum number of projector pixels in a scene with epipolar slices: 4096 × 4096. Epipolar slices need 24
/// bytes of memory per pixel.
const MAX_EPIPOLAR_PIXELS: u64 = 1 << 24;

pub(crate) fn build(
    ctx: &mut Context,
    file: &SceneFile,
    camera: &Pinhole,
    projector: Option<&Projector>,
) -> Result<Vec<Slice>, InputError> {
    let mut slices: Vec<Slice> = Vec::new();
    for s in &file.slices {
        let name = &*s.name;
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        if name.is_empty() || !name.chars().all(plain) || RESERVED.contains(&name.as_str()) {
            return Err(ctx.error(
                s.name.span(),
                format!("`{name}` is not a valid name of a slice"),
                "use letters, digits, _ and -; the name `samples` is reserved",
            ));
        }
        if slices.iter().any(|o| o.name == *name) {
            bail!(ctx, s.name.span(), "duplicate slice name `{name}`", "rename one of the slices");
        }
        let slice = Slice {
            name: name.clone(),
            camera: camera_select(ctx, &s.camera, camera.resolution)?,
            projector: projector_select(ctx, s, camera, projector)?,
            time: time_select(ctx, &s.time)?,
            polarization: match s.polarization {
                PolarizationFile::Mueller => Polarization::Mueller,
                PolarizationFile::Intensity => Polarization::Intensity,
            },
            bounces: s.bounces,
            split_first_bounce: s.split_first_bounce,
            labels: s.labels,
        };
        slices.push(slice);
    }
    let tile = &file.render.tile;
    let multiple = bin_multiple(&slices);
    if !u64::from(**tile).is_multiple_of(multiple) {
        let span = if tile.span() == (0..0) { file.slices[0].span() } else { tile.span() };
        return Err(ctx.error(
            span,
            format!("a tile of {0} × {0} pixels does not contain a whole number of camera bins", **tile),
            format!("set render.tile to a multiple of {multiple}, or choose other bins"),
        ));
    }
    let extents = tensor::axes::Extents {
        camera: camera.resolution,
        projector: projector.map(|p| p.pinhole.resolution),
        wavelengths_nm: ctx.wavelengths.nm().to_vec(),
        max_depth: *file.render.max_depth,
        tile: (**tile).max(1),
    };
    for (slice, s) in slices.iter().zip(&file.slices) {
        let layout = SliceLayout::new(slice, &extents);
        let product = |n: Vec<u64>| n.into_iter().map(u128::from).product::<u128>();
        let elements = product(layout.shape());
        if elements > MAX_ELEMENTS {
            return Err(ctx.error(
                s.span(),
                format!(
                    "slice `{}` would have {elements} elements, more than the supported maximum of {MAX_ELEMENTS}",
                    slice.name
                ),
                "keep fewer camera pixels, projector pixels or bins (for example a row, a block or larger bins)",
            ));
        }
        let chunk = product(layout.chunk_shape());
        if chunk > MAX_CHUNK {
            return Err(ctx.error(
                s.span(),
                format!(
                    "slice `{}` would have {chunk} elements in one tile, more than the supported maximum of {MAX_CHUNK}",
                    slice.name
                ),
                "reduce render.tile, or keep fewer entries in the slice",
            ));
        }
    }
    Ok(slices)
}

/// Checks that the numbers in a list of rows or columns increase strictly and are in range.
fn listed(
    ctx: &Context,
    list: &[u32],
    limit: u32,
    span: Range<usize>,
    what: &str,
) -> Result<Vec<u32>, InputError> {
    let fault = if list.is_empty() {
        "the list is empty".to_owned()
    } else if let Some(i) = list.iter().find(|i| **i >= limit) {
        format!("the index {i} is not below {limit}")
    } else if let Some([a, b]) = list.windows(2).find_map(|w| (w[0] >= w[1]).then_some([w[0], w[1]])) {
        format!("the indices {a} and {b} are not in increasing order")
    } else {
        return Ok(list.to_vec());
    };
    let fix = format!("list each index once, in increasing order, from 0 to {}", limit - 1);
    Err(ctx.error(span, format!("{what}: {fault}"), fix))
}

fn block(ctx: &Context, b: [u32; 4], [w, h]: [u32; 2], span: Range<usize>) -> Result<Block, InputError> {
    let [x, y, bw, bh] = b;
    let fits = |a: u32, n: u32, limit: u32| n >= 1 && a.checked_add(n).is_some_and(|e| e <= limit);
    if !fits(x, bw, w) || !fits(y, bh, h) {
        return Err(ctx.error(
            span,
            format!("the block {b:?} does not fit into the image of {w} × {h} pixels"),
            "give [x, y, width, height] inside the image, with a width and height of at least 1",
        ));
    }
    Ok(Block { x, y, w: bw, h: bh })
}

fn bin(
    ctx: &Context,
    [nx, ny]: [u32; 2],
    [w, h]: [u32; 2],
    span: Range<usize>,
) -> Result<(u32, u32), InputError> {
    if nx == 0 || ny == 0 || nx > w || ny > h {
        return Err(ctx.error(
            span,
            format!("bins of {nx} × {ny} pixels do not fit into an image of {w} × {h} pixels"),
            "give bins of at least 1 pixel and at most the size of the image",
        ));
    }
    Ok((nx, ny))
}

fn camera_select(
    ctx: &Context,
    s: &Located<CameraSelectFile>,
    size: [u32; 2],
) -> Result<CameraSelect, InputError> {
    let span = s.span();
    Ok(match &**s {
        CameraSelectFile::All => CameraSelect::All,
        CameraSelectFile::Rows(r) => CameraSelect::Rows(listed(ctx, r, size[1], span, "camera rows")?),
        CameraSelectFile::Columns(c) => {
            CameraSelect::Columns(listed(ctx, c, size[0], span, "camera columns")?)
        }
        CameraSelectFile::Block(b) => CameraSelect::Block(block(ctx, *b, size, span)?),
        CameraSelectFile::Binned(b) => {
            let (nx, ny) = bin(ctx, b.0, size, span)?;
            CameraSelect::Binned { nx, ny }
        }
    })
}

fn projector_select(
    ctx: &mut Context,
    slice: &SliceFile,
    camera: &Pinhole,
    projector: Option<&Projector>,
) -> Result<ProjectorSelect, InputError> {
    let s = &slice.projector;
    let span = s.span();
    match **s {
        ProjectorSelectFile::Sum => return Ok(ProjectorSelect::Sum),
        ProjectorSelectFile::Ambient => return Ok(ProjectorSelect::Ambient),
        _ => {}
    }
    let Some(projector) = projector else {
        return Err(ctx.error(
            span,
            "the slice resolves projector pixels, but the scene has no projector",
            "add a [projector], or use projector = \"sum\"",
        ));
    };
    let size = projector.pinhole.resolution;
    let half_width = |ctx: &Context, h: f64| {
        if (0.0..=65_536.0).contains(&h) {
            Ok(h as f32)
        } else {
            Err(ctx.error(
                span.clone(),
                format!("half_width_px is {h}, outside the supported range"),
                "give a number of projector pixels from 0 to 65536",
            ))
        }
    };
    Ok(match &**s {
        ProjectorSelectFile::Sum => ProjectorSelect::Sum,
        ProjectorSelectFile::Ambient => ProjectorSelect::Ambient,
        ProjectorSelectFile::All => ProjectorSelect::All,
        ProjectorSelectFile::Rows(r) => {
            ProjectorSelect::Rows(listed(ctx, r, size[1], span, "projector rows")?)
        }
        ProjectorSelectFile::Columns(c) => {
            ProjectorSelect::Columns(listed(ctx, c, size[0], span, "projector columns")?)
        }
        ProjectorSelectFile::Block(b) => ProjectorSelect::Block(block(ctx, *b, size, span)?),
        ProjectorSelectFile::Binned(b) => {
            let (nx, ny) = bin(ctx, b.0, size, span)?;
            ProjectorSelect::Binned { nx, ny }
        }
        ProjectorSelectFile::Mask(name) => mask(ctx, name, size, span)?,
        ProjectorSelectFile::Moment(of) => moment(*of, size),
        ProjectorSelectFile::Epipolar(_) | ProjectorSelectFile::Nonepipolar(_)
            if size.iter().map(|n| u64::from(*n)).product::<u64>() > MAX_EPIPOLAR_PIXELS =>
        {
            return Err(ctx.error(
                span,
                format!("epipolar slices do not support a projector of {} × {} pixels", size[0], size[1]),
                "use a projector with at most 2^24 (4096 × 4096) pixels",
            ));
        }
        ProjectorSelectFile::Epipolar(e) => {
            let half_width_px = half_width(ctx, e.half_width_px)?;
            match e.along {
                None => ProjectorSelect::Epipolar { half_width_px },
                Some(along) => ProjectorSelect::EpipolarAlong {
                    half_width_px,
                    along: match along {
                        CoordinateFile::U => ProjectorAxis::U,
                        CoordinateFile::V => ProjectorAxis::V,
                    },
                },
            }
        }
        ProjectorSelectFile::Nonepipolar(h) => {
            ProjectorSelect::NonEpipolar { half_width_px: half_width(ctx, h.half_width_px)? }
        }
        ProjectorSelectFile::Coaxial if size != camera.resolution => {
            return Err(ctx.error(
                span,
                format!(
                    "a coaxial slice requires equal resolutions, but the camera has {} × {} pixels and the projector has \
                     {} × {} pixels",
                    camera.resolution[0], camera.resolution[1], size[0], size[1]
                ),
                "set equal resolutions, or set coaxial = true in [projector]",
            ));
        }
        ProjectorSelectFile::Coaxial => ProjectorSelect::Coaxial,
    })
}

/// Returns a projector mask that weights each pixel by the pixel's column or row coordinate.
fn moment(of: CoordinateFile, [w, h]: [u32; 2]) -> ProjectorSelect {
    let pixels = (0..h).flat_map(|v| (0..w).map(move |u| (u, v)));
    let (name, weights) = match of {
        CoordinateFile::U => ("moment u", pixels.map(|(u, _)| u as f32).collect()),
        CoordinateFile::V => ("moment v", pixels.map(|(_, v)| v as f32).collect()),
    };
    ProjectorSelect::Mask { name: name.to_owned(), weights }
}

/// Reads an image as a projector mask. The linear brightness of each pixel is the weight of that projector
/// pixel.
fn mask(
    ctx: &mut Context,
    name: &str,
    [w, h]: [u32; 2],
    span: Range<usize>,
) -> Result<ProjectorSelect, InputError> {
    let image = textures::decoded(ctx, &Located::at(span.clone(), name.to_owned()), None)?;
    if (image.width, image.height) != (w as usize, h as usize) {
        return Err(ctx.error(
            span,
            format!(
                "{name} has {} × {} pixels, but the projector has {w} × {h} pixels",
                image.width, image.height
            ),
            "scale the image to the projector's resolution",
        ));
    }
    let weights = picture::weights(&image);
    let outside = weights.iter().filter(|v| !(0.0..=1.0).contains(*v)).count();
    if outside > 0 {
        return Err(ctx.error(
            span,
            format!("{name}: {outside} pixels have values outside 0..1"),
            "give a drive image with values from 0 (black) to 1",
        ));
    }
    Ok(ProjectorSelect::Mask { name: name.to_owned(), weights })
}

fn time_select(ctx: &Context, t: &TimeFile) -> Result<TimeSelect, InputError> {
    let TimeFile::Bins(b) = t else {
        return Ok(TimeSelect::Sum);
    };
    for (key, value, sound, fix) in [
        (
            "bin_ps",
            *b.bin_ps,
            b.bin_ps.is_finite() && *b.bin_ps > 0.0,
            "give a bin width above 0 in picoseconds",
        ),
        ("start_ps", b.start_ps, b.start_ps.is_finite(), "give a finite start in picoseconds"),
    ] {
        if !sound {
            return Err(ctx.error(
                b.bin_ps.span(),
                format!("{key} is {value}, outside the supported range"),
                fix,
            ));
        }
    }
    if !(1..=1 << 20).contains(&*b.bins) {
        return Err(ctx.error(b.bins.span(), format!("bins is {}", *b.bins), "give 1 to 1048576 bins"));
    }
    // The bin width must be representable next to the latest time. A representable bin width makes bin edges
    // finite and increasing, and bin centres different.
    let end = b.start_ps + f64::from(*b.bins) * *b.bin_ps;
    let latest = b.start_ps.abs().max(end.abs());
    if !(latest.is_finite() && latest * LEAST_BIN < *b.bin_ps) {
        return Err(ctx.error(
            b.bin_ps.span(),
            format!(
                "bins of {} ps from {} to {end} ps are too narrow for single precision",
                *b.bin_ps, b.start_ps
            ),
            "use wider bins or earlier times",
        ));
    }
    Ok(TimeSelect::Bins { start_ps: b.start_ps, bin_ps: *b.bin_ps, bins: *b.bins })
}

/// Returns the least common multiple of the camera bin sizes. Tile sizes must be a multiple of this number.
fn bin_multiple(slices: &[Slice]) -> u64 {
    let gcd = |mut a: u64, mut b: u64| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    slices.iter().fold(1, |m, s| match s.camera {
        CameraSelect::Binned { nx, ny } => {
            let m = m / gcd(m, u64::from(nx)) * u64::from(nx);
            m / gcd(m, u64::from(ny)) * u64::from(ny)
        }
        _ => m,
    })
}
