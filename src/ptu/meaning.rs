//! Detects header tags that change the meaning of the records but that the reader does not use.

use super::header::Header;
use super::record::Mode;
use super::scan::{Scan, is_bidirectional};

/// Name prefixes of tags that describe the file, the program, the hardware or results. No tag with one of
/// these prefixes is known to affect a photon's channel, time or pixel.
const DESCRIPTIVE: [&str; 22] = [
    "$",
    "CreatorSW_",
    "DefaultParameters",
    "Det",
    "Fast_Load_End",
    "File_",
    "HW",
    "Hist",
    "MeasDesc_",
    "Measurement_",
    "Opt",
    "PIETSetup",
    "SWSetting",
    "ScopeView",
    "StgCtrl_",
    "StgScan_",
    "TTResult_",
    "TTResultFormat_",
    "TrueTime",
    "Usr",
    "Var",
    "View",
];

/// Image tags that [`Scan::of_header`] reads, and tags that state the position of the image and the planned
/// number of frames.
const IMAGE: [&str; 18] = [
    "ImgHdr_BiDirect",
    "ImgHdr_Dimensions",
    "ImgHdr_Frame",
    "ImgHdr_FrameFrequency",
    "ImgHdr_Ident",
    "ImgHdr_LineFrequency",
    "ImgHdr_LineStart",
    "ImgHdr_LineStop",
    "ImgHdr_MaxFrames",
    "ImgHdr_PixResol",
    "ImgHdr_PixX",
    "ImgHdr_PixY",
    "ImgHdr_ScanDirection",
    "ImgHdr_SinCorrection",
    "ImgHdr_TimePerPixel",
    "ImgHdr_X0",
    "ImgHdr_Y0",
    "ReqHdr_ScanningPattern",
];

/// Returns notes on header tags that may change the meaning of the records. There is one note for each tag
/// that a histogram ignores or interprets ambiguously.
pub fn notes(header: &Header, mode: Mode, scan: Option<&Scan>) -> Vec<String> {
    let mut notes = vec![];
    let is = |name: &str| header.number(name).unwrap_or(0.0);
    let divider = is("HWSync_Divider");
    if mode == Mode::T2 && divider > 1.0 {
        notes.push(format!(
            "HWSync_Divider is {divider}: the file has one sync pulse per {divider} laser pulses, and times are relative to the sync pulse"
        ));
    }
    if is("ReqHdr_ScanningPattern") != 0.0 && !is_bidirectional(header) && scan.is_some() {
        notes.push(
            "ReqHdr_ScanningPattern is ignored: ImgHdr_BiDirect is not set, so rows are read in one direction"
                .into(),
        );
    }
    if let Some(sine) = scan.and_then(|s| s.clock.sweep?.sine) {
        notes.push(format!(
            "ImgHdr_SinCorrection is applied: lines cover {:.3} % of a sine's amplitude (PicoQuant's definition)",
            100.0 * sine
        ));
    }
    if let (None, Some(width), Some(height)) =
        (scan, header.number("ImgHdr_PixX"), header.number("ImgHdr_PixY"))
    {
        notes.push(format!(
            "the header describes an image of {width} × {height} pixels; photons of all pixels are summed (use --pixels for the image)"
        ));
    }
    let mut unknown: Vec<&str> = vec![];
    for tag in &header.tags {
        let name = tag.name.as_str();
        let known = IMAGE.contains(&name) || DESCRIPTIVE.iter().any(|d| name.starts_with(d));
        if !known && !unknown.contains(&name) {
            unknown.push(name);
        }
    }
    if !unknown.is_empty() {
        let names: Vec<String> = unknown.iter().take(10).map(|n| n.escape_default().to_string()).collect();
        let more = unknown.len() - names.len();
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        notes.push(format!("these unknown tags of the header are ignored: {}{more}", names.join(", ")));
    }
    notes
}
