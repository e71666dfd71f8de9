//! Frames on their way to disk, beside the run: a thread that writes each, syncs, and only then notes it in the journal.
//!
//! A frame that is a chunk of the store goes straight there. Small ones (histograms) are first appended to a log of the chunk
//! that they are part of, and become a chunk when it is full; the log is emptied after that, so that a frame is always in
//! the one or the other. Frames that wait are synced together. Time tags go the same way beside their histograms, before them.

use super::journal::{Event, FrameRecord, Journal};
use super::time_tags::{self, Scale, TagLog, Tags};
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use store::zarr::frames::FrameStore;

/// The log of a chunk that is not full, in the store's folder.
const LOG: &str = ".session.frames";
/// Frames that wait at most: what a power cut can cost.
const WAITING: usize = 64;

/// What comes to the writer.
enum Item {
    Frame(FrameRecord, Vec<u32>, Option<Tags>),
    Event(Event),
    /// Write all that came and say so.
    Flush(SyncSender<()>),
}

/// What ended the writer.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {cause}; free disk space and resume: all recorded frames are saved")]
pub struct DiskError {
    /// Where.
    pub path: PathBuf,
    /// What the system says.
    pub cause: String,
}

/// A thread that writes.
pub struct Writer {
    sender: Option<SyncSender<Item>>,
    thread: Option<JoinHandle<Result<(), DiskError>>>,
}

/// What the thread works with.
struct Work {
    store: FrameStore,
    journal: Journal,
    log: File,
    tags: Option<TagLog>,
    /// Numbers of the chunk that is not full.
    part: Vec<u32>,
    /// Chunks that the disk need not have yet.
    unsynced: Vec<usize>,
    disk_full: Option<Box<dyn FnMut() -> bool + Send>>,
}

/// CRC-32C of a frame's numbers.
#[must_use]
pub fn checksum(numbers: &[u32]) -> u32 {
    let bytes: Vec<u8> = numbers.iter().flat_map(|n| n.to_le_bytes()).collect();
    crc32c::crc32c(&bytes)
}

/// What of a run's store is sound, and what the log holds of the chunk that is not full.
pub struct Recovered {
    /// Frames that are on disk, from the first on.
    pub frames: u32,
    part: Vec<u32>,
    /// Time tags of the same frames, where these are kept.
    tags: Vec<Tags>,
}

/// Compares a store with its journal, from the first frame on: frames whose numbers are not what the journal says end what
/// is sound.
///
/// # Errors
/// If the journal cannot be read.
pub fn recover(store: &FrameStore) -> io::Result<Recovered> {
    let crcs = super::journal::frames(store.path(), |r| (r.crc, r.tags_crc))?;
    let (per, len) = (store.layout().frames_per_chunk(), store.layout().frame_len());
    let logged = read_log(store.path(), len).unwrap_or_default();
    let tagged = crcs.iter().any(|(_, tags)| tags.is_some());
    let logged_tags = if tagged {
        time_tags::read_log(store.path())
    } else {
        vec![]
    };
    let mut part = vec![];
    let mut tags = vec![];
    let mut sound = 0;
    while sound < crcs.len() {
        let chunk = sound / per;
        let end = (sound + per).min(crcs.len());
        let numbers = if end - sound == per {
            store.read_chunk(chunk).ok()
        } else {
            None
        };
        let of_chunk = |n: usize| {
            let numbers = numbers.as_deref()?;
            numbers.get((n - sound) * len..(n - sound + 1) * len)
        };
        let of_log = |n: usize| {
            logged
                .iter()
                .rev()
                .find(|(f, _)| *f == n as u32)
                .map(|(_, d)| &d[..])
        };
        let row = if tagged {
            time_tags::read_row(store.path(), chunk, per)
        } else {
            None
        };
        let tags_of = |n: usize, want: u32| {
            let of_row = row
                .as_ref()
                .and_then(|r| r.get(n - sound))
                .filter(|t| t.checksum() == want);
            let logged = || {
                logged_tags
                    .iter()
                    .rev()
                    .find(|(f, t)| *f == n as u32 && t.checksum() == want)
            };
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
            // Also a full chunk whose file is lost, but whose log is there: it is filled again from the log.
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
    Ok(Recovered {
        frames: sound as u32,
        part,
        tags,
    })
}

/// Frames of the log, up to the first that is torn.
fn read_log(store: &Path, len: usize) -> io::Result<Vec<(u32, Vec<u32>)>> {
    let mut file = base::input::open(&store.join(LOG))?;
    let mut frames = vec![];
    let mut record = vec![0; 4 + 4 * len + 4];
    loop {
        if file.read_exact(&mut record).is_err() {
            return Ok(frames);
        }
        let words: Vec<u32> = record
            .chunks_exact(4)
            .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect();
        let (body, seal) = record.split_at(4 + 4 * len);
        if crc32c::crc32c(body).to_le_bytes() != seal[..] {
            return Ok(frames);
        }
        frames.push((words[0], words[1..=len].to_vec()));
    }
}

impl Writer {
    /// Begins to write a store, at the frame behind what was recovered; with time tags of some scale, or without.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn new(
        store: FrameStore,
        recovered: Recovered,
        tags: Option<Scale>,
        disk_full: Option<Box<dyn FnMut() -> bool + Send>>,
    ) -> Result<Self, DiskError> {
        let path = store.path().to_owned();
        let failed = |e: io::Error| DiskError {
            path: path.clone(),
            cause: e.to_string(),
        };
        let journal = Journal::open(&path).map_err(failed)?;
        let log = OpenOptions::new()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(path.join(LOG))
            .map_err(failed)?;
        let tags = tags
            .map(|scale| TagLog::new(&path, scale))
            .transpose()
            .map_err(failed)?;
        let mut work = Work {
            store,
            journal,
            log,
            tags,
            part: vec![],
            unsynced: vec![],
            disk_full,
        };
        // The log anew, with what is sound in it alone.
        let len = work.store.layout().frame_len().max(1);
        let first = recovered.frames as usize - recovered.part.len() / len;
        work.empty_log().map_err(failed)?;
        for (i, frame) in recovered.part.chunks_exact(len).enumerate() {
            work.append_log((first + i) as u32, frame).map_err(failed)?;
        }
        if let Some(log) = &mut work.tags {
            for (i, tags) in recovered.tags.into_iter().enumerate() {
                log.append((first + i) as u32, tags).map_err(failed)?;
            }
            log.sync().map_err(failed)?;
        }
        work.part = recovered.part;
        let (sender, receiver) = sync_channel(WAITING);
        let thread = std::thread::spawn(move || {
            let result = work.serve(&receiver);
            // The store goes with its lock.
            result.map_err(|cause| DiskError { path, cause })
        });
        Ok(Self {
            sender: Some(sender),
            thread: Some(thread),
        })
    }

    fn send(&mut self, item: Item) -> Result<(), DiskError> {
        let sent = self.sender.as_ref().is_some_and(|s| s.send(item).is_ok());
        if sent { Ok(()) } else { self.close() }
    }

    /// Hands a frame over; waits where too many wait.
    ///
    /// # Errors
    /// [`DiskError`] that an earlier one met.
    pub fn frame(
        &mut self,
        record: FrameRecord,
        numbers: Vec<u32>,
        tags: Option<Tags>,
    ) -> Result<(), DiskError> {
        self.send(Item::Frame(record, numbers, tags))
    }

    /// Notes what happened.
    ///
    /// # Errors
    /// As [`Self::frame`].
    pub fn event(&mut self, event: Event) -> Result<(), DiskError> {
        self.send(Item::Event(event))
    }

    /// Waits until all that was handed over is on disk.
    ///
    /// # Errors
    /// As [`Self::frame`].
    pub fn flush(&mut self) -> Result<(), DiskError> {
        let (sender, receiver) = sync_channel(1);
        self.send(Item::Flush(sender))?;
        if receiver.recv().is_ok() {
            Ok(())
        } else {
            self.close()
        }
    }

    /// Waits for the end of all that was handed over, and closes the store.
    ///
    /// # Errors
    /// As [`Self::frame`].
    pub fn close(&mut self) -> Result<(), DiskError> {
        self.sender = None;
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(result)) => result,
            Some(Err(_)) => Err(DiskError {
                path: PathBuf::new(),
                cause: "the writer thread ended unexpectedly".into(),
            }),
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
            // All that waits is synced together.
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
        // What was written before a failure is noted all the same.
        for chunk in std::mem::take(&mut self.unsynced) {
            self.store.sync_chunk(chunk).map_err(io)?;
        }
        self.log.sync_data().map_err(io)?;
        if let Some(tags) = &self.tags {
            tags.sync().map_err(io)?;
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
            self.store
                .write_chunk(chunk, &numbers)
                .map_err(|e| e.to_string())?;
            self.unsynced.push(chunk);
            return Ok(());
        }
        if (frame as usize).is_multiple_of(per) {
            // The chunk before is in its place.
            self.part.clear();
            self.empty_log().map_err(|e| e.to_string())?;
        }
        self.append_log(frame, &numbers).map_err(|e| e.to_string())?;
        self.part.extend(numbers);
        if self.part.len() == per * len {
            self.store
                .write_chunk(chunk, &self.part)
                .map_err(|e| e.to_string())?;
            // Before its log is emptied.
            self.store.sync_chunk(chunk).map_err(|e| e.to_string())?;
        }
        Ok(())
    }

    fn empty_log(&mut self) -> io::Result<()> {
        self.log.set_len(0)?;
        self.log.rewind()
    }

    fn append_log(&mut self, frame: u32, numbers: &[u32]) -> io::Result<()> {
        let mut bytes = Vec::with_capacity(8 + 4 * numbers.len());
        bytes.extend(frame.to_le_bytes());
        bytes.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
        let seal = crc32c::crc32c(&bytes);
        bytes.extend(seal.to_le_bytes());
        self.log.write_all(&bytes)
    }
}

/// A point's tags, and its row's file with the last of them.
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

/// Removes the logs: all frames are in chunks.
///
/// # Errors
/// If the file system refuses.
pub fn remove_log(store: &Path) -> io::Result<()> {
    time_tags::remove_log(store)?;
    match std::fs::remove_file(store.join(LOG)) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(e),
        _ => Ok(()),
    }
}
