//! A simulated camera in memory. The camera has the bootstrap registers of GenCP, a manifest with XML, and
//! feature registers that control its behaviour. Pixel k of frame n has the value n + k.

use super::stream::{Block, Frames};
use crate::clock::locked;
use crate::instrument::{PixelFormat, Region, pixels};
use cameleon::{ControlError, ControlResult, DeviceControl, StreamError};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

const XML: &str = include_str!("fake.xml");
const MANIFEST: usize = 0x1000;
const FILE: usize = 0x2000;
const REGISTERS: usize = 0x20000;

/// A fault that the camera can simulate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Trouble {
    #[default]
    None,
    /// The cable is disconnected.
    Gone,
    /// The camera does not reply.
    Silent,
    /// Another program uses the camera.
    Busy,
    /// Frames never arrive.
    NoFrames,
    /// A frame arrives with one byte missing.
    Short,
    /// A frame of another region arrives.
    Stale,
}

/// State of the simulated camera.
pub struct State {
    memory: Vec<u8>,
    /// Addresses and new values of all registers that the host has written, in order.
    pub written: Vec<(usize, u32)>,
    pub trouble: Trouble,
    pub opened: bool,
    /// Whether the camera has enabled the stream, and whether the host receives the stream.
    pub streaming: [bool; 2],
    acquiring: bool,
    begun: Instant,
    count: u64,
    waiting: VecDeque<(Instant, Block)>,
}

/// A simulated camera that several lines can share.
#[derive(Clone)]
pub struct Fake(Arc<Mutex<State>>);

impl Fake {
    /// Creates an idle camera in its factory state, with the full sensor and automatic exposure.
    pub fn new() -> Self {
        let mut state = State {
            memory: vec![0; REGISTERS + 0x100],
            written: vec![],
            trouble: Trouble::None,
            opened: false,
            streaming: [false; 2],
            acquiring: false,
            begun: Instant::now(),
            count: 0,
            waiting: VecDeque::new(),
        };
        let m = &mut state.memory;
        let mut put = |at: usize, bytes: &[u8]| m[at..at + bytes.len()].copy_from_slice(bytes);
        put(0x0000, &[0, 0, 1, 0]);
        put(0x0004, b"Sunstone");
        put(0x0044, b"Fake 16 x 12");
        put(0x00C4, b"0.1");
        put(0x0144, b"F-0001");
        put(0x01D0, &(MANIFEST as u64).to_le_bytes());
        put(MANIFEST, &1_u64.to_le_bytes());
        // The manifest states version 1.0.0 of the file, and uncompressed XML of schema 1.1.
        put(MANIFEST + 8, &[0, 0, 0, 1]);
        put(MANIFEST + 12, &[0, 0, 1, 1]);
        put(MANIFEST + 16, &(FILE as u64).to_le_bytes());
        put(MANIFEST + 24, &(XML.len() as u64).to_le_bytes());
        assert!(FILE + XML.len() < REGISTERS, "the XML is too long for the fake's memory");
        put(FILE, XML.as_bytes());
        for (i, value) in [16_u32, 12, 0, 0, 0x0108_0001, 100_000].iter().enumerate() {
            put(REGISTERS + 4 * i, &value.to_le_bytes());
        }
        put(REGISTERS + 0x34, &2_u32.to_le_bytes());
        put(REGISTERS + 0x38, &41.5_f32.to_le_bytes());
        Self(Arc::new(Mutex::new(state)))
    }

    /// Locks the state for reading or changing.
    pub fn state(&self) -> MutexGuard<'_, State> {
        locked(&self.0)
    }

    fn line(&self) -> ControlResult<MutexGuard<'_, State>> {
        let state = self.state();
        match state.trouble {
            Trouble::Gone => Err(ControlError::Disconnected),
            Trouble::Silent => Err(ControlError::Timeout),
            Trouble::Busy => Err(ControlError::Busy),
            _ if !state.opened => Err(ControlError::NotOpened),
            _ => Ok(state),
        }
    }
}

impl State {
    /// Returns a 32-bit register.
    pub fn register(&self, address: usize) -> u32 {
        u32::from_le_bytes(self.memory[address..address + 4].try_into().expect("four bytes"))
    }

    fn expose(&mut self) {
        let at = |i: usize| self.register(REGISTERS + 4 * i);
        let region = Region { x: at(2), y: at(3), width: at(0), height: at(1) };
        let format = match at(4) {
            0x0108_0001 => PixelFormat::Mono8,
            0x010A_0046 => PixelFormat::Mono10p,
            0x010C_0047 => PixelFormat::Mono12p,
            other => panic!("pixels {other:#x}"),
        };
        let exposure = Duration::from_nanos(u64::from(at(5)) * 100);
        let numbers: Vec<u32> = (0..region.width * region.height).map(|k| k + self.count as u32).collect();
        let mut block = Block {
            region,
            format: Some(format),
            bytes: pixels::pack(&numbers, format),
            number: self.count,
            timestamp: self.begun.elapsed(),
        };
        self.count += 1;
        match self.trouble {
            Trouble::NoFrames => return,
            Trouble::Short => drop(block.bytes.pop()),
            Trouble::Stale => block.region.y += 2,
            _ => {}
        }
        self.waiting.push_back((Instant::now() + exposure, block));
    }

    fn effect(&mut self, address: usize) {
        let value = self.register(address);
        self.written.push((address, value));
        match address - REGISTERS {
            0x24 if self.acquiring && self.register(REGISTERS + 0x1C) == 1 => self.expose(),
            0x28 => self.acquiring = self.streaming[0],
            0x2C => self.acquiring = false,
            _ => {}
        }
    }
}

impl DeviceControl for Fake {
    fn open(&mut self) -> ControlResult<()> {
        self.state().opened = true;
        self.line().map(drop).inspect_err(|_| self.state().opened = false)
    }

    fn close(&mut self) -> ControlResult<()> {
        self.state().opened = false;
        Ok(())
    }

    fn is_opened(&self) -> bool {
        self.state().opened
    }

    fn read(&mut self, address: u64, buffer: &mut [u8]) -> ControlResult<()> {
        let state = self.line()?;
        let at = address as usize;
        let found = state.memory.get(at..at + buffer.len());
        buffer.copy_from_slice(found.ok_or(ControlError::BufferTooSmall)?);
        Ok(())
    }

    fn write(&mut self, address: u64, data: &[u8]) -> ControlResult<()> {
        let mut state = self.line()?;
        let at = address as usize;
        let locked = state.register(REGISTERS + 0x30) == 1;
        // Features that define the stream's layout are locked while the stream runs.
        if at < REGISTERS || data.len() != 4 || (locked && at < REGISTERS + 0x14) {
            return Err(ControlError::InvalidData("this register cannot be written now".into()));
        }
        state.memory[at..at + 4].copy_from_slice(data);
        state.effect(at);
        Ok(())
    }

    /// Finds the XML through the bootstrap registers, as in a real camera.
    fn genapi(&mut self) -> ControlResult<String> {
        let mut word = |at: u64| -> ControlResult<u64> {
            let mut bytes = [0; 8];
            self.read(at, &mut bytes)?;
            Ok(u64::from_le_bytes(bytes))
        };
        let manifest = word(0x01D0)?;
        let (file, size) = (word(manifest + 16)?, word(manifest + 24)?);
        let mut text = vec![0; size as usize];
        self.read(file, &mut text)?;
        Ok(String::from_utf8_lossy(&text).into_owned())
    }

    fn enable_streaming(&mut self) -> ControlResult<()> {
        self.line()?.streaming[0] = true;
        Ok(())
    }

    fn disable_streaming(&mut self) -> ControlResult<()> {
        self.line()?.streaming[0] = false;
        Ok(())
    }
}

impl Frames for Fake {
    fn open(&mut self) -> Result<(), StreamError> {
        Ok(())
    }

    fn close(&mut self) -> Result<(), StreamError> {
        Frames::stop(self)
    }

    fn start(&mut self, _control: &mut dyn DeviceControl) -> Result<(), StreamError> {
        let mut state = self.state();
        state.waiting.clear();
        state.streaming[1] = true;
        Ok(())
    }

    fn next(&mut self, within: Duration) -> Result<Option<Block>, StreamError> {
        let until = Instant::now() + within;
        loop {
            let mut state = self.state();
            if state.trouble == Trouble::Gone {
                return Err(StreamError::Disconnected);
            }
            if state.waiting.front().is_some_and(|(ready, _)| *ready <= Instant::now()) {
                return Ok(state.waiting.pop_front().map(|(_, block)| block));
            }
            drop(state);
            if Instant::now() >= until {
                return Ok(None);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    fn stop(&mut self) -> Result<(), StreamError> {
        self.state().streaming[1] = false;
        Ok(())
    }
}
