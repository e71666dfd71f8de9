//! Tests the register values of the driver, their order, and failures, with a camera in memory.

use super::camera::GenICamCamera;
use super::fake::{Fake, Trouble};
use super::stream::{Frames, Streamed};
use crate::conformance;
use crate::instrument::{
    AreaCamera, CameraSettings, Fault, Instrument, PixelFormat, Region, Trigger, pixels,
};
use cameleon::payload::PayloadSender;
use cameleon::{DeviceControl, PayloadStream, StreamError};
use std::time::{Duration, Instant};

const WITHIN: Duration = Duration::from_secs(2);

fn camera(fake: &Fake) -> GenICamCamera {
    let row_time = Duration::from_micros(10);
    GenICamCamera::new("camera", Box::new(fake.clone()), Box::new(fake.clone()), row_time).expect("a camera")
}

fn settings() -> CameraSettings {
    CameraSettings {
        region: Region { x: 4, y: 6, width: 8, height: 4 },
        exposure: Duration::from_micros(1500),
        gain_db: 6.5,
        format: PixelFormat::Mono12p,
        trigger: Trigger::Software,
    }
}

#[test]
fn a_camera_conforms() {
    conformance::area_camera(&mut camera(&Fake::new())).assert_passed("GenICam camera", 18);
}

/// The driver writes features to their registers in the registers' units. It writes the stream layout first,
/// then the lock and the start command.
#[test]
fn features_reach_their_registers() {
    let fake = Fake::new();
    let mut camera = camera(&fake);
    let limits = camera.limits();
    assert_eq!((limits.size, limits.step), ([16, 12], [4, 2]));
    assert_eq!(limits.exposure, [Duration::from_micros(10), Duration::from_secs(10)]);
    assert_eq!(limits.gain_db, [0.0, 24.0]);
    assert_eq!(limits.formats, [PixelFormat::Mono8, PixelFormat::Mono10p, PixelFormat::Mono12p]);
    assert_eq!(camera.temperature_c(), Some(41.5));
    let identity = camera.identify(WITHIN).expect("answers");
    assert_eq!(
        [identity.maker, identity.model, identity.serial, identity.firmware],
        ["Sunstone", "Fake 16 x 12", "F-0001", "0.1"]
    );
    // The driver turned off the automatic exposure, which was on.
    assert_eq!(std::mem::take(&mut fake.state().written), [(0x20034, 0)]);
    camera.configure(&settings(), WITHIN).expect("sets");
    assert_eq!(
        std::mem::take(&mut fake.state().written),
        [
            (0x2002C, 1),
            (0x20030, 0),
            (0x20008, 0),
            (0x2000C, 0),
            (0x20000, 8),
            (0x20004, 4),
            (0x20008, 4),
            (0x2000C, 6),
            (0x20010, 0x010C_0047),
            (0x20034, 0),
            (0x20014, 15_000),
            (0x20018, 65),
            (0x2001C, 1),
            (0x20020, 7),
            (0x20030, 1),
            (0x20028, 1),
        ]
    );
    assert_eq!(fake.state().streaming, [true; 2]);
    let begun = Instant::now();
    camera.expose().expect("exposes");
    let frame = camera.frame(WITHIN).expect("a frame");
    assert!(begun.elapsed() >= settings().exposure);
    assert_eq!(std::mem::take(&mut fake.state().written), [(0x20024, 1)]);
    assert_eq!(pixels::unpack(&frame), Some((0..32).collect()));
    // The region moves to an offset at which the earlier width would not fit.
    let mut wide = settings();
    wide.region = Region { x: 12, y: 0, width: 4, height: 12 };
    wide.trigger = Trigger::Line;
    camera.configure(&wide, WITHIN).expect("sets");
    let written = std::mem::take(&mut fake.state().written);
    assert_eq!(written[..3], [(0x2002C, 1), (0x20030, 0), (0x20008, 0)]);
    assert_eq!(fake.state().register(0x20008), 12);
    assert_eq!(fake.state().register(0x20020), 1);
    drop(camera);
    let state = fake.state();
    assert!(state.streaming == [false; 2] && !state.opened && state.register(0x20030) == 0);
}

#[test]
fn camera_faults_are_reported() {
    for (trouble, fault) in [
        (Trouble::Gone, Fault::Disconnected),
        (Trouble::Silent, Fault::Timeout),
        (Trouble::Busy, Fault::Refused),
    ] {
        let fake = Fake::new();
        let mut camera = camera(&fake);
        camera.configure(&settings(), WITHIN).expect("sets");
        fake.state().trouble = trouble;
        for failure in [
            camera.identify(WITHIN).err(),
            camera.expose().err(),
            camera.configure(&settings(), WITHIN).err(),
            camera.reconnect(WITHIN).err(),
        ] {
            let failure = failure.expect("it fails");
            assert_eq!(failure.fault, fault, "{trouble:?}: {failure}");
        }
        fake.state().trouble = Trouble::None;
        camera.reconnect(WITHIN).expect("connects");
        assert_eq!(camera.expose().expect_err("settings are forgotten").fault, Fault::Refused);
        camera.configure(&settings(), WITHIN).expect("sets");
        camera.expose().expect("exposes");
        camera.frame(WITHIN).expect("a frame");
    }
    let fake = Fake::new();
    let mut camera = camera(&fake);
    camera.configure(&settings(), WITHIN).expect("sets");
    for (trouble, fault) in [(Trouble::NoFrames, Fault::Timeout), (Trouble::Stale, Fault::Disconnected)] {
        fake.state().trouble = trouble;
        camera.expose().expect("exposes");
        let failure = camera.frame(Duration::from_millis(50)).expect_err("no frame");
        assert_eq!(failure.fault, fault, "{failure}");
        fake.state().trouble = Trouble::None;
        camera.configure(&settings(), WITHIN).expect("sets");
    }
    // An incomplete frame is returned unchanged.
    fake.state().trouble = Trouble::Short;
    camera.expose().expect("exposes");
    assert_eq!(pixels::unpack(&camera.frame(WITHIN).expect("a frame")), None);
    let mut off = settings();
    off.exposure = Duration::from_micros(1_000_000_000);
    assert_eq!(camera.configure(&off, WITHIN).expect_err("too long").fault, Fault::Limit);
    off = settings();
    off.format = PixelFormat::Mono16;
    let failure = camera.configure(&off, WITHIN).expect_err("no such pixels");
    assert!(failure.fault == Fault::Limit && failure.what.contains("Mono8, Mono10p, Mono12p"), "{failure}");
}

/// A stream of `cameleon` that sends an error and closes.
struct Broken(Option<PayloadSender>);

impl PayloadStream for Broken {
    fn open(&mut self) -> Result<(), StreamError> {
        Ok(())
    }
    fn close(&mut self) -> Result<(), StreamError> {
        Ok(())
    }
    fn start_streaming_loop(
        &mut self,
        sender: PayloadSender,
        _: &mut dyn DeviceControl,
    ) -> Result<(), StreamError> {
        sender.try_send(Err(StreamError::InvalidPayload("torn".into())))?;
        self.0 = Some(sender);
        Ok(())
    }
    fn stop_streaming_loop(&mut self) -> Result<(), StreamError> {
        self.0 = None;
        Ok(())
    }
    fn is_loop_running(&self) -> bool {
        self.0.is_some()
    }
}

/// The driver handles three outcomes of `cameleon`'s channel: a damaged frame, no frame in time, and a closed
/// sender.
#[test]
fn outcomes_of_cameleon_streams_are_handled() {
    let mut frames = Streamed::new(Broken(None));
    frames.open().expect("opens");
    frames.start(&mut Fake::new()).expect("starts");
    assert!(matches!(frames.next(WITHIN), Err(StreamError::InvalidPayload(_))));
    let begun = Instant::now();
    assert!(matches!(frames.next(Duration::from_millis(30)), Ok(None)));
    assert!(begun.elapsed() >= Duration::from_millis(30));
    frames.hang_up();
    assert!(matches!(frames.next(WITHIN), Err(StreamError::Disconnected)));
    frames.stop().expect("stops");
    assert!(matches!(frames.next(WITHIN), Err(StreamError::Disconnected)));
}

impl Streamed<Broken> {
    fn hang_up(&mut self) {
        self.stream_mut().0 = None;
    }
}

/// `cameleon`'s own reader of the bootstrap registers finds the simulated camera's values.
#[cfg(feature = "usb3_vision")]
#[test]
fn the_simulated_camera_follows_the_standard() {
    use cameleon::u3v::register_map::{Abrm, GenICamFileType};
    let mut fake = Fake::new();
    DeviceControl::open(&mut fake).expect("opens");
    let abrm = Abrm::new(&mut fake).expect("bootstrap registers");
    assert_eq!(abrm.manufacturer_name(&mut fake).expect("a name"), "Sunstone");
    assert_eq!(abrm.model_name(&mut fake).expect("a name"), "Fake 16 x 12");
    assert_eq!(abrm.device_version(&mut fake).expect("a version"), "0.1");
    assert_eq!(abrm.serial_number(&mut fake).expect("a number"), "F-0001");
    let table = abrm.manifest_table(&mut fake).expect("a manifest");
    let entries: Vec<_> = table.entries(&mut fake).expect("entries").collect();
    assert_eq!(entries.len(), 1);
    let info = entries[0].file_info(&mut fake).expect("a file");
    assert!(info.file_type().expect("a type") == GenICamFileType::DeviceXml);
    let (at, size) = (
        entries[0].file_address(&mut fake).expect("an address"),
        entries[0].file_size(&mut fake).expect("a size"),
    );
    let mut text = vec![0; size as usize];
    fake.read(at, &mut text).expect("reads");
    assert_eq!(String::from_utf8_lossy(&text), fake.genapi().expect("XML"));
}
