//! The writer thread, which writes each frame, syncs the frame to disk, and only then records the frame in
//! the journal.
//!
//! A frame that is a whole chunk of the store is written directly. Smaller frames (histograms) are first
//! appended to a log. When the log contains all frames of a chunk, the chunk is written. The log is emptied
//! after the chunk is written, so that a frame is always in the log or in a chunk. Queued frames are synced
//! together. Time tags are written in the same way, before their histograms.

use super::journal::{Event, FrameRecord, Journal};
use super::sealed_log::{self, SealedLog};
use super::time_tags::{self, Scale, TagLog, Tags};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use store::zarr::frames::FrameStore;

/// File name of the log of an incomplete chunk.
const LOG: &str = ".session.frames";
/// Maximum number of queued frames. A power cut can lose the queued frames.
const WAITING: usize = 64;

enum Item {
    Frame(FrameRecord, Vec<u32>, Option<Tags>),
    Event(Event),
    /// Writes all earlier items, then replies.
    Flush(SyncSender<()>),
}

/// The error that ended the writer thread.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {cause}; free disk space and resume: all recorded frames are saved")]
pub struct DiskError {
    pub path: PathBuf,
    pub cause: String,
}

/// A handle to the writer thread.
pub struct Writer {
    sender: Option<SyncSender<Item>>,
    thread: Option<JoinHandle<Result<(), DiskError>>>,
}

/// The state of the writer thread.
struct Work {
    store: FrameStore,
    journal: Journal,
    log: SealedLog,
    tags: Option<TagLog>,
    /// Pixel values or counts of the incomplete chunk.
    part: Vec<u32>,
    /// Indices of chunks that are written but might not be on disk yet.
    unsynced: Vec<usize>,
    disk_full: Option<Box<dyn FnMut() -> bool + Send>>,
}

/// Returns the CRC-32C of the values of a frame.
pub fn checksum(numbers: &[u32]) -> u32 {
    let bytes: Vec<u8> = numbers.iter().flat_map(|n| n.to_le_bytes()).collect();
    crc32c::crc32c(&bytes)
}

/// The intact part of a run's store, and the frames of the incomplete chunk in the log.
pub struct Recovered {
    /// Number of intact frames, counted from the first frame of the run.
    pub frames: u32,
    part: Vec<u32>,
    /// Time tags of the logged frames, if the run stores time tags.
    tags: Vec<Tags>,
}

/// Compares a store with its journal. The first frame with a different checksum ends the intact part.
///
/// # Errors
/// Returns an error if the journal cannot be read.
pub fn recover(store: &FrameStore) -> io::Result<Recovered> {
    let crcs = super::journal::frames(store.path(), |r| (r.crc, r.tags_crc))?;
    let (per, len) = (store.layout().frames_per_chunk(), store.layout().frame_len());
    let logged = read_log(store.path(), len);
    let tagged = crcs.iter().any(|(_, tags)| tags.is_some());
    let logged_tags = if tagged { time_tags::read_log(store.path()) } else { vec![] };
    let mut part = vec![];
    let mut tags = vec![];
    let mut sound = 0;
    while sound < crcs.len() {
        let chunk = sound / per;
        let end = (sound + per).min(crcs.len());
        let numbers = if end - sound == per { store.read_chunk(chunk).ok() } else { None };
        let of_chunk = |n: usize| {
            let numbers = numbers.as_deref()?;
            numbers.get((n - sound) * len..(n - sound + 1) * len)
        };
        let of_log = |n: usize| logged.iter().rev().find(|(f, _)| *f == n as u32).map(|(_, d)| &d[..]);
        let row = if tagged { time_tags::read_row(store.path(), chunk, per) } else { None };
        let tags_of = |n: usize, want: u32| {
            let of_row = row.as_ref().and_then(|r| r.get(n - sound)).filter(|t| t.checksum() == want);
            let logged = || logged_tags.iter().rev().find(|(f, t)| *f == n as u32 && t.checksum() == want);
            of_row.or_else(|| logged().map(|(_, t)| t)).cloned()
        };
        let mut good = sound;
        let mut kept = vec![];
        let mut kept_tags = vec![];
        for (n, (want, want_tags)) in crcs.iter().enumerate().take(end).skip(sound) {
            let want = *want;
            if let Some(want) = want_tags {
                let Some(found) = tags_of(n, *want) else {
                    break;
                };
                kept_tags.push(found);
            }
            let found = of_chunk(n).filter(|d| checksum(d) == want);
            let Some(found) = found.or_else(|| of_log(n).filter(|d| checksum(d) == want)) else {
                kept_tags.truncate(good - sound);
                break;
            };
            kept.extend_from_slice(found);
            good = n + 1;
        }
        if good < sound + per {
            // If the file of a full chunk is lost but the log is intact, the chunk is rebuilt from the log.
            (part, tags, sound) = (kept, kept_tags, good);
            break;
        }
        if numbers.is_none_or(|numbers| numbers != kept) || tagged && row.as_ref() != Some(&kept_tags) {
            kept_tags.pop();
            (part, tags, sound) = (kept[..(per - 1) * len].to_vec(), kept_tags, good - 1);
            break;
        }
        sound = good;
    }
    Ok(Recovered { frames: sound as u32, part, tags })
}

/// Returns the frames of the log, up to the first incomplete frame.
fn read_log(store: &Path, len: usize) -> Vec<(u32, Vec<u32>)> {
    let frame = |record: Vec<u8>| {
        let mut words = record.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b));
        Some((words.next()?, words.collect()))
    };
    let records = sealed_log::read(&store.join(LOG), |_| Some(4 + 4 * len));
    records.into_iter().filter_map(frame).collect()
}

impl Writer {
    /// Starts the writer at the frame after the recovered frames. `tags` is the scale of the time tags, if
    /// the run stores time tags.
    ///
    /// # Errors
    /// Returns [`DiskError`] if the file system reports an error.
    pub fn new(
        store: FrameStore,
        recovered: Recovered,
        tags: Option<Scale>,
        disk_full: Option<Box<dyn FnMut() -> bool + Send>>,
    ) -> Result<Self, DiskError> {
        let path = store.path().to_owned();
        let failed = |e: io::Error| DiskError { path: path.clone(), cause: e.to_string() };
        let journal = Journal::open(&path).map_err(failed)?;
        let log = SealedLog::new(&path.join(LOG)).map_err(failed)?;
        let tags = tags.map(|scale| TagLog::new(&path, scale)).transpose().map_err(failed)?;
        let mut work = Work { store, journal, log, tags, part: vec![], unsynced: vec![], disk_full };
        // Rewrite the log with the intact frames only.
        let len = work.store.layout().frame_len().max(1);
        let first = recovered.frames as usize - recovered.part.len() / len;
        for (i, frame) in recovered.part.chunks_exact(len).enumerate() {
            work.append_log((first + i) as u32, frame).map_err(failed)?;
        }
        if let Some(log) = &mut work.tags {
            for (i, tags) in recovered.tags.into_iter().enumerate() {
                log.append((first + i) as u32, tags).map_err(failed)?;
            }
            log.log.sync().map_err(failed)?;
        }
        work.part = recovered.part;
        let (sender, receiver) = sync_channel(WAITING);
        let thread = std::thread::spawn(move || {
            let result = work.serve(&receiver);
            // The store and its lock are dropped here.
            result.map_err(|cause| DiskError { path, cause })
        });
        Ok(Self { sender: Some(sender), thread: Some(thread) })
    }

    fn send(&mut self, item: Item) -> Result<(), DiskError> {
        let sent = self.sender.as_ref().is_some_and(|s| s.send(item).is_ok());
        if sent { Ok(()) } else { self.close() }
    }

    /// Queues a frame. Blocks while the queue is full.
    ///
    /// # Errors
    /// Returns [`DiskError`] if writing an earlier item failed.
    pub fn frame(
        &mut self,
        record: FrameRecord,
        numbers: Vec<u32>,
        tags: Option<Tags>,
    ) -> Result<(), DiskError> {
        self.send(Item::Frame(record, numbers, tags))
    }

    /// Queues an event for the journal.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::frame`].
    pub fn event(&mut self, event: Event) -> Result<(), DiskError> {
        self.send(Item::Event(event))
    }

    /// Waits until all queued items are on disk.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::frame`].
    pub fn flush(&mut self) -> Result<(), DiskError> {
        let (sender, receiver) = sync_channel(1);
        self.send(Item::Flush(sender))?;
        if receiver.recv().is_ok() { Ok(()) } else { self.close() }
    }

    /// Waits until all queued items are on disk, and closes the store.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::frame`].
    pub fn close(&mut self) -> Result<(), DiskError> {
        self.sender = None;
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(result)) => result,
            Some(Err(_)) => {
                Err(DiskError { path: PathBuf::new(), cause: "the writer thread ended unexpectedly".into() })
            }
            None => Ok(()),
        }
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        let _ = self.close();
    }
}

impl Work {
    fn serve(&mut self, receiver: &Receiver<Item>) -> Result<(), String> {
        while let Ok(first) = receiver.recv() {
            // Write all queued items with a single sync.
            let mut waiting = vec![first];
            waiting.extend(receiver.try_iter());
            self.write(waiting)?;
        }
        Ok(())
    }

    fn write(&mut self, items: Vec<Item>) -> Result<(), String> {
        let (mut events, mut done) = (vec![], vec![]);
        let mut full = None;
        let io = |e: io::Error| e.to_string();
        for item in items {
            match item {
                Item::Event(event) => events.push(event),
                Item::Flush(sender) => done.push(sender),
                Item::Frame(record, numbers, tags) => {
                    if self.disk_full.as_mut().is_some_and(|f| f()) {
                        full = Some(io::Error::from(io::ErrorKind::StorageFull).to_string());
                        break;
                    }
                    if let Err(e) = self.put(record.frame, numbers, tags) {
                        full = Some(e);
                        break;
                    }
                    events.push(Event::Frame(record));
                }
            }
        }
        // Frames that were written before a failure are also recorded in the journal.
        for chunk in std::mem::take(&mut self.unsynced) {
            self.store.sync_chunk(chunk).map_err(io)?;
        }
        self.log.sync().map_err(io)?;
        if let Some(tags) = &self.tags {
            tags.log.sync().map_err(io)?;
        }
        self.journal.append(&events).map_err(io)?;
        drop(done.iter().map(|d| d.send(())).collect::<Vec<_>>());
        full.map_or(Ok(()), Err)
    }

    fn put(&mut self, frame: u32, numbers: Vec<u32>, tags: Option<Tags>) -> Result<(), String> {
        let layout = self.store.layout();
        let (per, len) = (layout.frames_per_chunk(), layout.frame_len());
        let chunk = frame as usize / per;
        if let (Some(log), Some(tags)) = (&mut self.tags, tags) {
            put_tags(log, frame as usize, per, tags).map_err(|e| e.to_string())?;
        }
        if per == 1 {
            self.store.write_chunk(chunk, &numbers).map_err(|e| e.to_string())?;
            self.unsynced.push(chunk);
            return Ok(());
        }
        if (frame as usize).is_multiple_of(per) {
            // The previous chunk is complete.
            self.part.clear();
            self.log.empty().map_err(|e| e.to_string())?;
        }
        self.append_log(frame, &numbers).map_err(|e| e.to_string())?;
        self.part.extend(numbers);
        if self.part.len() == per * len {
            self.store.write_chunk(chunk, &self.part).map_err(|e| e.to_string())?;
            // Sync the chunk before its log is emptied.
            self.store.sync_chunk(chunk).map_err(|e| e.to_string())?;
        }
        Ok(())
    }

    fn append_log(&mut self, frame: u32, numbers: &[u32]) -> io::Result<()> {
        self.log.append([frame].iter().chain(numbers).flat_map(|n| n.to_le_bytes()).collect())
    }
}

/// Appends a point's tags to the log. After the last point of a row, the row's file is written.
fn put_tags(log: &mut TagLog, frame: usize, per: usize, tags: Tags) -> io::Result<()> {
    if frame.is_multiple_of(per) {
        log.empty()?;
    }
    log.append(frame as u32, tags)?;
    if (frame + 1).is_multiple_of(per) {
        log.finish_row(frame / per)?;
    }
    Ok(())
}

/// Removes the logs of a finished run.
///
/// # Errors
/// Returns an error if a log cannot be removed.
pub fn remove_log(store: &Path) -> io::Result<()> {
    time_tags::remove_log(store)?;
    sealed_log::remove(&store.join(LOG))
}
