//! Tests that the SVG document is valid and that every format is produced deterministically.

use std::path::Path;

use super::*;
use AxisKind::{StokesIn, StokesOut, T, U, Wavelength, X, Y};
use roxmltree::Document;

fn full() -> Tensor {
    let axes = vec![
        counted(Y, 3),
        counted(X, 5),
        counted(U, 4),
        counted(T, 6),
        counted(StokesOut, 4),
        counted(StokesIn, 4),
        axis(Wavelength, RGB_NM.to_vec()),
    ];
    tensor(axes, |at| {
        let same = at.i(StokesOut) == at.i(StokesIn);
        (at.f(X) + 1.0) * (at.f(T) + 0.5) * if same { 1.0 } else { -0.3 }
    })
}

fn frames(n: usize) -> Vec<Drawing> {
    let view = FlightView { slice: "s".into(), frames: n };
    animate(&view, "t", &panel(&full())).unwrap()
}

#[test]
fn a_photograph_is_an_image_in_a_frame_with_texts() {
    let drawing = draw(&photo_view(), "A <title> & more", &panel(&full())).unwrap();
    let svg = drawing.svg();
    let xml = Document::parse(&svg).unwrap();
    let named = |name: &'static str| xml.descendants().filter(move |e| e.has_tag_name(name));
    let r = drawing.data;
    assert_eq!(images(&drawing), [r]);
    let frame = named("rect").find(|e| e.attribute("fill") == Some("none")).unwrap();
    assert_eq!(frame.attribute("x"), Some((r.x - 0.5).to_string().as_str()));
    assert_eq!(frame.attribute("width"), Some((r.w + 1.0).to_string().as_str()));
    let texts: Vec<&str> = named("text").filter_map(|e| e.text()).collect();
    for text in ["A <title> & more", "camera column [pixel]", "camera row [pixel]", "0", "4"] {
        assert!(texts.contains(&text), "{text} is not in {texts:?}");
    }
    assert!(texts.iter().any(|t| t.starts_with("Red 660 nm, green 550 nm, blue 450 nm.")));
    // Every text is on the page.
    for at in named("text").filter_map(|e| e.attribute("x")) {
        assert!((0.0..f64::from(drawing.width())).contains(&at.parse().unwrap()));
    }
}

#[test]
fn maps_have_images_and_profiles_have_paths() {
    let t = full();
    for (view, images) in all_views().iter().zip([1, 17, 17, 2, 2, 2, 2, 6, 0, 0]) {
        let svg = draw(view, "t", &panel(&t)).unwrap().svg();
        let xml = Document::parse(&svg).unwrap();
        let count = |name| xml.descendants().filter(|e| e.has_tag_name(name)).count();
        assert_eq!(count("image"), images, "{view:?}");
        assert!(count("text") > 5, "{view:?}");
        let lines = |e: &roxmltree::Node| e.attribute("stroke-linecap").is_some();
        let lines = xml.descendants().filter(lines).count();
        assert_eq!(lines >= 3, matches!(view, View::Profile(_)), "{view:?}: {lines} lines");
    }
}

#[test]
#[ignore = "slow: tools/check --all"]
fn equal_inputs_give_equal_bytes_in_every_format() {
    let (t, folder) = (full(), tempfile::tempdir().unwrap());
    let at = |name: &str| folder.path().join(name);
    let read = |name: &str| std::fs::read(at(name)).unwrap();
    for (i, view) in all_views().iter().enumerate() {
        for (format, head) in [("png", "\u{fffd}PNG"), ("svg", "<svg "), ("pdf", "%PDF-")] {
            // Not all views are rasterized, because rasterizing is slow and the SVG determines the pixels.
            if format == "png" && i % 4 > 0 {
                continue;
            }
            for name in ["a", "b"] {
                let drawing = draw(view, "title", &panel(&t)).unwrap();
                save(&drawing, &at(&format!("{name}.{format}"))).unwrap();
            }
            let bytes = read(&format!("a.{format}"));
            assert_eq!(bytes, read(&format!("b.{format}")), "{view:?} {format}");
            assert!(String::from_utf8_lossy(&bytes).starts_with(head), "{view:?} {format}");
        }
    }
    for name in ["a.gif", "a.apng"] {
        save_animation(&frames(3), &at(name)).unwrap();
        let first = read(name);
        save_animation(&frames(3), &at(name)).unwrap();
        assert_eq!(first, read(name), "{name}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 8, "temporary files are left");
}

#[test]
fn extensions_select_formats() {
    assert_eq!(Format::of(Path::new("a/b.PNG")).unwrap(), Format::Png);
    assert_eq!(Format::of(Path::new("b.svg")).unwrap(), Format::Svg);
    assert_eq!(Format::of(Path::new("b.c.pdf")).unwrap(), Format::Pdf);
    let moving = ["b.Gif", "b.apng", "b.png", "gif"].map(|p| is_animation(Path::new(p)));
    assert_eq!(moving, [true, true, false, false]);
    let e = save_animation(&frames(1), Path::new("a.png")).unwrap_err();
    assert!(e.to_string().contains(".gif or .apng"), "{e}");
    let drawing = draw(&photo_view(), "", &panel(&full())).unwrap();
    for name in ["a.jpg", "a.gif", "png", "a"] {
        let e = save(&drawing, Path::new(name)).unwrap_err().to_string();
        assert!(e.starts_with(name) && e.contains(".png, .svg or .pdf"), "{e}");
    }
    let file = tempfile::NamedTempFile::new().unwrap();
    assert!(matches!(save(&drawing, &file.path().join("no/a.png")), Err(FigureError::Write { .. })));
}

/// Returns the characters to which the fonts of a PDF map their glyphs.
fn letters(pdf: &str) -> String {
    let maps = pdf.split("beginbfchar").skip(1);
    let pairs = maps.flat_map(|m| m.split("endbfchar").next().unwrap_or("").lines());
    let units = pairs.filter_map(|l| l.rsplit_once('<')?.1.strip_suffix('>').map(str::to_owned));
    units
        .map(|hex| {
            let units: Vec<u16> = (0..hex.len() / 4)
                .map(|i| u16::from_str_radix(&hex[4 * i..4 * i + 4], 16).unwrap())
                .collect();
            String::from_utf16(&units).unwrap()
        })
        .collect()
}

/// Tests that a PDF page contains the text as glyphs of an embedded font with a character map.
#[test]
fn texts_of_a_pdf_can_be_selected() {
    let title = "Wörter, Σ and M00 × 10⁻³";
    let drawing = draw(&photo_view(), title, &panel(&full())).unwrap();
    let bytes = drawing.pdf_with(false).unwrap();
    let pdf = String::from_utf8_lossy(&bytes);
    let known = letters(&pdf);
    for c in title.chars().chain("camera column [pixel]".chars()).filter(|c| *c != ' ') {
        assert!(known.contains(c), "{c} is not in {known}");
    }
    // Each text of the page is a separate text object.
    let texts = drawing.svg().matches("<text").count();
    assert!(pdf.matches("BT\n").count() >= texts && pdf.contains("/FontFile2"), "{texts} texts");
    assert!(drawing.pdf().unwrap().len() < bytes.len());
}

#[test]
#[ignore = "slow: tools/check --all"]
fn animations_have_their_frames() {
    let folder = tempfile::tempdir().unwrap();
    let frames = frames(5);
    let gif = folder.path().join("a.gif");
    save_animation(&frames, &gif).unwrap();
    let decoder =
        image::codecs::gif::GifDecoder::new(std::io::BufReader::new(std::fs::File::open(&gif).unwrap()));
    let decoded = image::AnimationDecoder::into_frames(decoder.unwrap()).collect_frames().unwrap();
    assert_eq!(decoded.len(), 5);
    // White pixels stay white, and black pixels stay black.
    for (drawing, frame) in frames.iter().zip(&decoded) {
        let pixels = drawing.pixels().unwrap();
        assert_eq!(pixels.dimensions(), frame.buffer().dimensions());
        let far = pixels.pixels().zip(frame.buffer().pixels()).filter(|(a, b)| {
            let white = a.0 == [255; 3] || a.0 == [0; 3];
            white && a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 8)
        });
        assert_eq!(far.count(), 0);
    }
    let apng = folder.path().join("a.apng");
    save_animation(&frames, &apng).unwrap();
    let file = std::io::BufReader::new(std::fs::File::open(&apng).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    assert_eq!(reader.info().animation_control().unwrap().num_frames, 5);
    let mut bytes = vec![0; reader.output_buffer_size()];
    for drawing in &frames {
        reader.next_frame(&mut bytes).unwrap();
        assert_eq!(bytes, drawing.pixels().unwrap().into_raw());
    }
    assert!(matches!(save_animation(&[], &gif), Err(FigureError::Encode(_))));
}
