//! Implements the lock of a store at a URL. The lock is an object that only one process can create, and that
//! its holder renews.
//!
//! The lock is created with a conditional put (`If-None-Match: *`). The holder rewrites the lock three times
//! per lease. A process that finds a lock watches the lock for one lease. If the lock is not renewed within
//! one lease, the holder has ended. The watching process then takes over the lock with a put that is
//! conditional on the watched version (`If-Match`). Clocks of different machines are never compared. A holder
//! whose last renewal began more than one lease ago does not write to the store.

use super::{Objects, Put, Version};
use crate::refusal::Refusal;
use base::lock::holder_name;
use bytes::Bytes;
use serde_json::{Value, json};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

/// Key of the lock's object.
pub(crate) const FILE: &str = ".sunstone-lock";
/// Default lease: the time after which a lock without renewal expires. The environment variable
/// `SUNSTONE_LEASE_S` overrides the default, in seconds.
const LEASE: Duration = Duration::from_secs(30);
const VARIABLE: &str = "SUNSTONE_LEASE_S";
/// Minimum and maximum lease in seconds.
const LEASES: [f64; 2] = [1.0, 3600.0];
/// Number of times that a watching process reads a lock during one lease.
const LOOKS: u32 = 10;

/// Returns the lease of the locks that this process takes.
pub(crate) fn lease() -> Duration {
    let given = std::env::var(VARIABLE).ok().and_then(|text| text.parse().ok());
    given.map_or(LEASE, believed)
}

fn believed(seconds: f64) -> Duration {
    if seconds.is_finite() { Duration::from_secs_f64(seconds.clamp(LEASES[0], LEASES[1])) } else { LEASE }
}

/// The reason why a lock was not taken.
#[derive(Debug)]
pub(crate) enum NoLock {
    /// Another process holds the lock. The value is the name of the holder.
    Held(String),
    /// The object store refused the request.
    Refused(Refusal),
}

impl From<Refusal> for NoLock {
    fn from(refusal: Refusal) -> Self {
        Self::Refused(refusal)
    }
}

/// The time until which this process certainly holds a lock, or `None` after the lock is lost.
#[derive(Debug)]
pub(crate) struct Hold(Mutex<Option<Instant>>);

impl Hold {
    /// Returns the remaining time during which the lock is certainly held.
    fn left(&self) -> Duration {
        let until = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        until.map_or(Duration::ZERO, |until| until.saturating_duration_since(Instant::now()))
    }

    /// Returns whether the lock is certainly held.
    pub(crate) fn is_sure(&self) -> bool {
        !self.left().is_zero()
    }

    fn set(&self, until: Option<Instant>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = until;
    }
}

/// A lock, held until it is dropped.
#[derive(Debug)]
pub(crate) struct ObjectLock {
    objects: Objects,
    hold: Arc<Hold>,
    lease: Duration,
    stop: Option<mpsc::Sender<()>>,
    renewal: Option<JoinHandle<()>>,
}

/// The content of the object that represents a lock.
struct Owner {
    name: String,
    key: String,
    lease: Duration,
    renewed: u64,
}

impl Owner {
    fn new(lease: Duration) -> Self {
        static COUNTER: AtomicU64 = AtomicU64::new(0);
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        let name = holder_name();
        let (n, t) = (COUNTER.fetch_add(1, Ordering::Relaxed), since.unwrap_or_default());
        Self { key: format!("{name} {} {n}", t.as_nanos()), name, lease, renewed: 0 }
    }

    fn text(&self) -> Bytes {
        let lease = self.lease.as_secs_f64();
        json!({"owner": self.name, "key": self.key, "lease_s": lease, "renewed": self.renewed})
            .to_string()
            .into_bytes()
            .into()
    }

    /// Returns whether this owner wrote a lock's object, given the object's bytes. If the response to a put
    /// is lost, the repeated put finds the object of the first put.
    fn wrote(&self, bytes: &[u8]) -> bool {
        parse(bytes)["key"] == self.key.as_str()
    }
}

fn parse(bytes: &[u8]) -> Value {
    serde_json::from_slice(bytes).unwrap_or_default()
}

impl ObjectLock {
    /// Takes the lock of a store at a URL.
    pub(crate) fn take(objects: &Objects, lease: Duration) -> Result<Self, NoLock> {
        let owner = Owner::new(lease);
        let (version, held) = acquire(objects, &owner)?;
        // Repeat the put, because some servers ignore its condition.
        if let Put::Done(_) = objects.put_new(FILE, owner.text())? {
            let _ = objects.delete(vec![FILE.into()]);
            return Err(NoLock::Refused(Refusal::new(
                "the server ignores the condition If-None-Match of put requests, so two processes could write the same store",
                "write to a local folder and copy the store, or use a server that supports conditional puts",
            )));
        }
        let (stop, stopped) = mpsc::channel();
        let hold = Arc::new(Hold(Mutex::new(Some(held + lease))));
        let renewal = std::thread::spawn({
            let (objects, hold) = (objects.clone(), hold.clone());
            move || renew(&objects, owner, version, &stopped, &hold)
        });
        Ok(Self { objects: objects.clone(), hold, lease, stop: Some(stop), renewal: Some(renewal) })
    }

    /// Returns the state of the lock.
    pub(crate) fn hold(&self) -> Arc<Hold> {
        self.hold.clone()
    }

    /// Stops the renewal without removing the lock, as if the process were killed.
    #[cfg(test)]
    pub(crate) fn abandon(mut self) {
        self.stop.take();
        if let Some(renewal) = self.renewal.take() {
            let _ = renewal.join();
        }
        self.hold.set(None);
    }
}

impl Drop for ObjectLock {
    fn drop(&mut self) {
        self.stop.take();
        if let Some(renewal) = self.renewal.take() {
            let _ = renewal.join();
        }
        // Delete the lock only if it cannot expire before the request arrives, because another process may
        // take over an expired lock.
        if self.hold.left() > self.lease / 3 {
            let _ = self.objects.delete(vec![FILE.into()]);
        }
        self.hold.set(None);
    }
}

/// Creates the object of a lock, or takes over an expired lock. Returns the object's version and the start
/// time of the lock.
fn acquire(objects: &Objects, owner: &Owner) -> Result<(Version, Instant), NoLock> {
    'free: loop {
        let begun = Instant::now();
        if let Put::Done(version) = objects.put_new(FILE, owner.text())? {
            return Ok((version, begun));
        }
        let Some((bytes, seen)) = objects.get_version(FILE)? else {
            std::thread::sleep(Duration::from_millis(50));
            continue;
        };
        if owner.wrote(&bytes) {
            return Ok((seen, begun));
        }
        let message = parse(&bytes);
        let holder = message["owner"].as_str().unwrap_or("another process").to_owned();
        let lease = message["lease_s"].as_f64().map_or(LEASE, believed);
        tracing::warn!(
            "the store is locked by {holder}: waiting {} s to see whether the lock is renewed",
            lease.as_secs_f64()
        );
        let begun = Instant::now();
        while begun.elapsed() < lease {
            std::thread::sleep(lease / LOOKS);
            match objects.get_version(FILE)? {
                None => continue 'free,
                Some((_, now)) if now != seen => return Err(NoLock::Held(holder)),
                Some(_) => {}
            }
        }
        let begun = Instant::now();
        return match objects.put_over(FILE, owner.text(), seen)? {
            Put::Done(version) => Ok((version, begun)),
            Put::Other => match objects.get_version(FILE)? {
                Some((bytes, version)) if owner.wrote(&bytes) => Ok((version, begun)),
                _ => Err(NoLock::Held(holder)),
            },
        };
    }
}

/// Renews a lock until it is stopped or lost.
fn renew(
    objects: &Objects,
    mut owner: Owner,
    mut version: Version,
    stopped: &mpsc::Receiver<()>,
    hold: &Hold,
) {
    let lease = owner.lease;
    let mut pause = lease / 3;
    while let Err(mpsc::RecvTimeoutError::Timeout) = stopped.recv_timeout(pause) {
        owner.renewed += 1;
        let begun = Instant::now();
        let renewed = match objects.put_over(FILE, owner.text(), version.clone()) {
            Ok(Put::Done(now)) => Some(now),
            Ok(Put::Other) => match objects.get_version(FILE) {
                Ok(Some((bytes, now))) if owner.wrote(&bytes) => Some(now),
                // The lock is lost, so the writer must stop immediately.
                Ok(_) => return hold.set(None),
                Err(_) => None,
            },
            Err(_) => None,
        };
        pause = match renewed {
            Some(now) => {
                version = now;
                hold.set(Some(begun + lease));
                lease / 3
            }
            None => lease / 15,
        };
    }
}
