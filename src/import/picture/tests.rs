//! Tests the decoders with files of known pixel values, which these tests or other encoders write.

use super::*;
use exr::prelude::*;
use image::{GrayImage, Luma, LumaA, Rgb, RgbImage};

const SIZE: [usize; 2] = [20, 9];

/// Returns a value that differs between pixels and that half precision represents exactly.
fn value(c: usize, x: usize, y: usize) -> f32 {
    ((c + 1) * 256 + x * 8 + y) as f32 / 64.0
}

fn plane(c: usize) -> FlatSamples {
    let [w, h] = SIZE;
    FlatSamples::F32((0..w * h).map(|k| value(c, k % w, k / w)).collect())
}

fn layer(
    channels: &[(&str, FlatSamples)],
    encoding: Encoding,
    name: Option<&str>,
) -> Layer<AnyChannels<FlatSamples>> {
    let list = channels.iter().map(|(n, s)| AnyChannel::new(*n, s.clone())).collect();
    let attributes = match name {
        Some(name) => LayerAttributes::named(name),
        None => LayerAttributes::default(),
    };
    Layer::new((SIZE[0], SIZE[1]), attributes, encoding, AnyChannels::sort(list))
}

/// Encodes an image of the crate `exr`. The encoder is a macro because the image's type depends on the
/// layers.
macro_rules! written {
    ($image:expr) => {{
        let mut bytes = Cursor::new(vec![]);
        $image.write().to_buffered(&mut bytes).expect("written");
        bytes.into_inner()
    }};
}

/// Encodes an OpenEXR image with the given channel names, separated by spaces. `Z=4` is a channel `Z` with
/// the values of plane 4.
fn openexr(names: &str) -> Vec<u8> {
    let plane = |(name, plane_of): (_, &str)| (name, plane(plane_of.parse().expect("a plane")));
    let channels: Vec<_> = names.split(' ').filter_map(|c| c.split_once('=')).map(plane).collect();
    written!(&Image::from_layer(layer(&channels, Encoding::FAST_LOSSLESS, None,)))
}

/// Checks that every pixel contains the values of the given planes.
fn assert_planes(pixels: &Pixels, planes: [usize; 3], what: &str) {
    assert_eq!([pixels.width, pixels.height], SIZE, "{what}");
    assert!(!pixels.encoded, "{what}");
    for (k, p) in pixels.values.iter().enumerate() {
        let want = planes.map(|c| value(c, k % SIZE[0], k / SIZE[0]));
        assert_eq!(*p, want, "{what}, pixel {k}");
    }
}

#[test]
fn openexr_channels_are_found_by_their_names() {
    let rgb = [0, 1, 2];
    for (names, planes) in [
        ("R=0 G=1 B=2", rgb),
        ("R=0 G=1 B=2 A=3", rgb),
        ("r=0 g=1 b=2", rgb),
        ("red=0 green=1 blue=2", rgb),
        ("Y=5", [5; 3]),
        ("Y=5 A=1", [5; 3]),
        ("Z=4", [4; 3]),
        ("A=4", [4; 3]),
        ("roughness=4", [4; 3]),
        ("V.Combined.R=0 V.Combined.G=1 V.Combined.B=2", rgb),
        (
            "V.Combined.R=0 V.Combined.G=1 V.Combined.B=2 V.Combined.A=3 V.Depth.Z=4 \
             V.Normal.X=5 V.Normal.Y=6 V.Normal.Z=7",
            rgb,
        ),
        ("V.Combined.R=0 V.Combined.G=1 V.Combined.B=2 V.DiffDir.R=4 V.DiffDir.G=5 V.DiffDir.B=6", rgb),
        ("R=0 G=1 B=2 diffuse.R=4 diffuse.G=5 diffuse.B=6", rgb),
    ] {
        let pixels = decode("a.exr", &openexr(names), None).expect("read");
        assert_planes(&pixels, planes, names);
        assert_eq!(pixels.to_rgb, None, "{names}");
    }
}

#[test]
fn openexr_layers_are_chosen_by_name_or_refused_with_their_list() {
    let bytes = openexr("diffuse.R=0 diffuse.G=1 diffuse.B=2 specular.R=4 specular.G=5 specular.B=6");
    let error = decode("a.exr", &bytes, None).expect_err("ambiguous");
    assert!(error.help.contains("`diffuse`, `specular`"), "{error:?}");
    let chosen = decode("a.exr", &bytes, Some("specular")).expect("read");
    assert_planes(&chosen, [4, 5, 6], "specular");
    let error = decode("a.exr", &bytes, Some("glossy")).expect_err("no such layer");
    assert!(error.message.contains("`glossy`") && error.help.contains("`specular`"), "{error:?}");
    for (names, second) in [("Y=0 RY=1 BY=2", "RY"), ("R=0 G=1", "G"), ("u=0 v=1", "V")] {
        let error = decode("a.exr", &openexr(names), None).expect_err("no image");
        assert!(error.message.contains(second), "{error:?}");
    }
}

#[test]
fn openexr_parts_are_layers() {
    let planes = |first: usize| ["R", "G", "B"].into_iter().zip([first, first + 1, first + 2].map(plane));
    let part = |name: &str, first| {
        let channels: Vec<_> = planes(first).collect();
        layer(&channels, Encoding::FAST_LOSSLESS, Some(name))
    };
    let attributes = || ImageAttributes::new(IntegerBounds::from_dimensions((SIZE[0], SIZE[1])));
    let both = Image::empty(attributes()).with_layer(part("left", 0)).with_layer(part("right", 4));
    let bytes = written!(&both);
    let error = decode("a.exr", &bytes, None).expect_err("ambiguous");
    assert!(error.help.contains("`left`, `right`"), "{error:?}");
    assert_planes(&decode("a.exr", &bytes, Some("right")).expect("read"), [4, 5, 6], "right");
    let single = written!(&Image::empty(attributes()).with_layer(part("beauty", 0)));
    assert_planes(&decode("a.exr", &single, None).expect("read"), [0, 1, 2], "a single part");
}

#[test]
fn openexr_storage_does_not_matter() {
    let rgb: Vec<_> = ["R", "G", "B"].into_iter().zip([0, 1, 2].map(plane)).collect();
    let half: Vec<_> = rgb
        .iter()
        .map(|(n, s)| (*n, FlatSamples::F16(s.values_as_f32().map(f16::from_f32).collect())))
        .collect();
    for compression in
        [Compression::Uncompressed, Compression::RLE, Compression::ZIP1, Compression::ZIP16, Compression::PIZ]
    {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(8, 4))] {
            for channels in [&rgb, &half] {
                let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
                let bytes = written!(&Image::from_layer(layer(channels, encoding, None)));
                let pixels = decode("a.exr", &bytes, None).expect("read");
                assert_planes(&pixels, [0, 1, 2], &format!("{compression:?} {blocks:?}"));
                let short = decode("a.exr", &bytes[..bytes.len() - 9], None).expect_err("cut short");
                assert!(short.message.contains("damaged"), "{short:?}");
            }
        }
    }
    let identifiers = FlatSamples::U32(vec![7; SIZE[0] * SIZE[1]]);
    let bytes = written!(&Image::from_layer(layer(&[("id", identifiers)], Encoding::UNCOMPRESSED, None,)));
    let error = decode("a.exr", &bytes, None).expect_err("identifiers");
    assert!(error.message.contains("identifiers"), "{error:?}");
}

/// Tests the conversion to BT.709. X, Y, Z of the white point D65 give equal red, green and blue. X, Y, Z of
/// BT.709's red give only red.
#[test]
fn colours_of_other_primaries_are_converted_to_srgb() {
    let constant = |v: f32| FlatSamples::F32(vec![v; SIZE[0] * SIZE[1]]);
    let xyz = |[x, y]: [f64; 2]| [x / y, 1.0, (1.0 - x - y) / y].map(|v| v as f32);
    let wavelengths = Wavelengths::new(vec![450.0, 550.0, 650.0]).expect("wavelengths");
    let bgr = |pixels: &Pixels| {
        let mut out = vec![];
        texels(pixels, Channels::Colours, &wavelengths, &mut out);
        out[7]
    };
    for (c, blue, green, red) in
        [(primaries::BT709[3], 1.0, 1.0, 1.0), (primaries::BT709[0], 0.0, 0.0, 1.0 / 0.212_639)]
    {
        let planes: Vec<_> = ["X", "Y", "Z"].into_iter().zip(xyz(c).map(constant)).collect();
        let bytes = written!(&Image::from_layer(layer(&planes, Encoding::UNCOMPRESSED, None)));
        let got = bgr(&decode("a.exr", &bytes, None).expect("read"));
        for (got, want) in got.into_iter().zip([blue, green, red]) {
            assert!((got - want).abs() < 2e-3, "{got}, {want}");
        }
    }
    // Rec. 2020 has the same white point as BT.709, so grey does not change. The green of Rec. 2020 is
    // outside the gamut of BT.709.
    let mut image = Image::from_layer(layer(
        &["R", "G", "B"].into_iter().zip([0.5, 0.5, 0.5].map(constant)).collect::<Vec<_>>(),
        Encoding::UNCOMPRESSED,
        None,
    ));
    image.attributes.chromaticities = Some(attribute_bt2020());
    let got = bgr(&decode("a.exr", &written!(&image), None).expect("read"));
    assert!(got[..3].iter().all(|v| (v - 0.5).abs() < 1e-4), "{got:?}");
}

fn attribute_bt2020() -> exr::meta::attribute::Chromaticities {
    exr::meta::attribute::Chromaticities {
        red: Vec2(0.708, 0.292),
        green: Vec2(0.17, 0.797),
        blue: Vec2(0.131, 0.046),
        white: Vec2(0.3127, 0.329),
    }
}

/// Pixels of an image with two columns and three rows, top row first. With exponent 128, the unit of a
/// mantissa is 1/256.
const RGBE: [[u8; 4]; 6] = [
    [10, 20, 30, 128],
    [11, 21, 31, 128],
    [12, 22, 32, 128],
    [13, 23, 33, 129],
    [14, 24, 34, 127],
    [0, 0, 0, 0],
];

fn radiance_value([r, g, b, e]: [u8; 4]) -> [f32; 3] {
    [r, g, b].map(|m| f32::from(m) / 256.0 * (f32::from(e) - 128.0).exp2())
}

fn radiance_file(head: &str, resolution: &str, order: impl IntoIterator<Item = usize>) -> Vec<u8> {
    let mut bytes = format!("{head}\n\n{resolution}\n").into_bytes();
    bytes.extend(order.into_iter().flat_map(|k| RGBE[k]));
    bytes
}

#[test]
fn radiance_headers_and_orientations_are_read() {
    let want = RGBE.map(radiance_value).to_vec();
    for head in [
        "#?RADIANCE\nFORMAT=32-bit_rle_rgbe",
        "#?RGBE\nFORMAT=32-bit_rle_rgbe",
        "#?RGBE",
        "#?AUTOPANO\n# a comment = of words\nSOFTWARE=x\nFORMAT=32-bit_rle_rgbe\nGAMMA=1\nEXPOSURE=1.0",
        "#?RADIANCE\r\nFORMAT=32-bit_rle_rgbe\r",
    ] {
        let head = head.replace("\r\n", "\n");
        let pixels = decode("a.hdr", &radiance_file(&head, "-Y 3 +X 2", 0..6), None).expect("read");
        assert_eq!((pixels.width, pixels.height, pixels.encoded), (2, 3, false), "{head}");
        assert_eq!(pixels.values, want, "{head}");
        assert!(pixels.notes.is_empty(), "{head}: {:?}", pixels.notes);
    }
    // All eight pixel orders give the same image.
    for (resolution, order) in [
        ("-Y 3 +X 2", [0, 1, 2, 3, 4, 5]),
        ("-Y 3 -X 2", [1, 0, 3, 2, 5, 4]),
        ("+Y 3 +X 2", [4, 5, 2, 3, 0, 1]),
        ("+Y 3 -X 2", [5, 4, 3, 2, 1, 0]),
        ("+X 2 -Y 3", [0, 2, 4, 1, 3, 5]),
        ("-X 2 -Y 3", [1, 3, 5, 0, 2, 4]),
        ("+X 2 +Y 3", [4, 2, 0, 5, 3, 1]),
        ("-X 2 +Y 3", [5, 3, 1, 4, 2, 0]),
    ] {
        let pixels = decode("a.hdr", &radiance_file("#?RADIANCE", resolution, order), None).expect("read");
        assert_eq!((pixels.width, pixels.height), (2, 3), "{resolution}");
        assert_eq!(pixels.values, want, "{resolution}");
    }
}

#[test]
fn radiance_exposures_are_divided_out() {
    let head = "#?RADIANCE\nEXPOSURE=2\nFORMAT=32-bit_rle_rgbe\nEXPOSURE= 4.0\nCOLORCORR= 1 2 0.5";
    let pixels = decode("a.hdr", &radiance_file(head, "-Y 3 +X 2", 0..6), None).expect("read");
    for (got, rgbe) in pixels.values.iter().zip(RGBE) {
        let [r, g, b] = radiance_value(rgbe);
        assert_eq!(*got, [r / 8.0, g / 16.0, b / 4.0]);
    }
    assert!(pixels.notes[0].contains("EXPOSURE"), "{:?}", pixels.notes);
}

#[test]
fn radiance_scan_lines_are_read_in_all_encodings() {
    // The line is run-length encoded per channel: a run of 9, and 1 + 8 literal values.
    let mut runs = b"#?RGBE\n\n-Y 1 +X 9\n\x02\x02\x00\x09".to_vec();
    runs.extend([128 + 9, 64, 1, 5, 8, 1, 2, 3, 4, 5, 6, 7, 8, 128 + 9, 32, 128 + 9, 129]);
    let pixels = decode("a.hdr", &runs, None).expect("read");
    let green = [5, 1, 2, 3, 4, 5, 6, 7, 8];
    let want: Vec<_> = green.iter().map(|g| radiance_value([64, *g, 32, 129])).collect();
    assert_eq!(pixels.values, want);
    // In the old encoding, the pixel is repeated 3 + 256 times.
    let mut old = b"#?RGBE\n\n-Y 1 +X 260\n".to_vec();
    old.extend([9, 8, 7, 128, 1, 1, 1, 3, 1, 1, 1, 1]);
    let pixels = decode("a.hdr", &old, None).expect("read");
    assert_eq!(pixels.values, vec![radiance_value([9, 8, 7, 128]); 260]);
    for bytes in [&runs[..runs.len() - 1], &old[..old.len() - 4]] {
        let error = decode("a.hdr", bytes, None).expect_err("cut short");
        assert!(error.message.contains("scan line 1 of 1"), "{error:?}");
    }
    for (text, what) in [
        (&b"#?RGBE\nFORMAT=32-bit_rle_luv\n\n-Y 1 +X 1\n1234"[..], "luv"),
        (b"#?RGBE\nEXPOSURE=0\n\n-Y 1 +X 1\n1234", "EXPOSURE=0"),
        (b"#?RGBE\n\n-Y 1 -Y 1\n1234", "-Y 1 -Y 1"),
        (b"#?RGBE\n\n-Y 99999999 +X 99999999\n1234", "99999999"),
        (b"#?RGBE\n-Y 1 +X 1\n", "truncated"),
    ] {
        let error = decode("a.hdr", text, None).expect_err("refused");
        assert!(error.message.contains(what), "{error:?}");
    }
}

#[test]
fn float_maps_are_read_from_the_bottom_in_either_byte_order() {
    let numbers = [1.0_f32, 2.0, 3.0, 4.0, 5.0, 6.0];
    let file = |head: &str, little: bool| {
        let mut bytes = head.as_bytes().to_vec();
        bytes.extend(numbers.iter().flat_map(|v| if little { v.to_le_bytes() } else { v.to_be_bytes() }));
        bytes
    };
    for (head, little, factor) in [("Pf\n2 3\n-1.0\n", true, 1.0), ("Pf 2 3\n2\n", false, 2.0)] {
        let pixels = decode("a.pfm", &file(head, little), None).expect("read");
        let want = [5.0, 6.0, 3.0, 4.0, 1.0, 2.0].map(|v| [v * factor; 3]);
        assert_eq!(pixels.values, want);
    }
    let pixels = decode("a.pfm", &file("PF\n1 2\n-1\n", true), None).expect("read");
    assert_eq!(pixels.values, [[4.0, 5.0, 6.0], [1.0, 2.0, 3.0]]);
    for head in ["PF\n1 3\n-1\n", "PF\n1 x\n-1\n", "PF\n0 2\n-1\n", "PF\n"] {
        assert!(decode("a.pfm", &file(head, true), None).is_err(), "{head}");
    }
}

/// Tests that 8-bit, 16-bit, grayscale and alpha variants of a picture give the same image.
#[test]
fn whole_numbers_are_read_from_every_format() {
    let grey = |x: u32, y: u32| (60 * x + 20 * y) as u8;
    let want: Vec<[f32; 3]> = (0..12).map(|k| [f32::from(grey(k % 4, k / 4)) / 255.0; 3]).collect();
    let images: [DynamicImage; 4] = [
        GrayImage::from_fn(4, 3, |x, y| Luma([grey(x, y)])).into(),
        image::GrayAlphaImage::from_fn(4, 3, |x, y| LumaA([grey(x, y), 7])).into(),
        RgbImage::from_fn(4, 3, |x, y| Rgb([grey(x, y); 3])).into(),
        image::ImageBuffer::<Luma<u16>, _>::from_fn(4, 3, |x, y| Luma([257 * u16::from(grey(x, y))])).into(),
    ];
    for (image, formats) in images.iter().zip([
        &[ImageFormat::Png, ImageFormat::Pnm, ImageFormat::Bmp, ImageFormat::Tga][..],
        &[ImageFormat::Png, ImageFormat::Tga],
        &[ImageFormat::Png, ImageFormat::Pnm, ImageFormat::Bmp, ImageFormat::Tga],
        &[ImageFormat::Png],
    ]) {
        for format in formats {
            let name = format!("a.{}", format.extensions_str()[0]);
            let bytes = encoded(image, *format).expect("written");
            let pixels = decode(&name, &bytes, None).unwrap_or_else(|e| panic!("{name}: {e:?}"));
            assert_eq!((pixels.width, pixels.height, pixels.encoded), (4, 3, true), "{name}");
            assert_eq!(pixels.values, want, "{name}");
            assert_eq!(weights(&pixels), want.iter().map(|p| p[0]).collect::<Vec<_>>(), "{name}");
        }
    }
    let error = decode("a.tif", b"II*\0\x08\0\0\0", None).expect_err("no TIFF");
    assert!(error.message.contains("Tiff"), "{error:?}");
    let error = decode("a.png", b"hello", None).expect_err("no image");
    assert!(error.message.contains("unknown image format"), "{error:?}");
    let png = encoded(&images[0], ImageFormat::Png).expect("written");
    let error = decode("a.png", &png[..png.len() / 2], None).expect_err("cut short");
    assert!(error.message.contains("PNG file is damaged"), "{error:?}");
    assert!(decode("a.png", &png, Some("x")).is_err());
}

/// Tests that a PNG chunk that declares linear colours produces a note.
#[test]
fn gamma_chunks_are_noted() {
    let image = DynamicImage::from(GrayImage::new(2, 2));
    let mut bytes = encoded(&image, ImageFormat::Png).expect("written");
    assert!(decode("a.png", &bytes, None).expect("read").notes.is_empty());
    // Insert gAMA 1.0, with its checksum, after the signature and the header chunk (33 bytes).
    let chunk: [u8; 16] = [0, 0, 0, 4, b'g', b'A', b'M', b'A', 0, 1, 0x86, 0xa0, 0x31, 0xe8, 0x96, 0x5f];
    bytes.splice(33..33, chunk);
    let notes = decode("a.png", &bytes, None).expect("read").notes;
    assert!(notes.len() == 1 && notes[0].contains("gAMA"), "{notes:?}");
}
