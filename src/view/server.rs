//! The server: listens on this computer only, and refuses requests of other pages.

use crate::answer::Answer;
use crate::error::ViewError;
use crate::page;
use crate::service::Service;
use oxhttp::Server;
use oxhttp::model::{Body, HeaderValue, Method, Request};
use rand::TryRng;
use rand::rngs::SysRng;
use std::io::Read;
use std::net::{Ipv4Addr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Maximum size of a request in bytes. The largest request contains a drive image of the projector as text.
const LARGEST: u64 = 32 << 20;

/// Maximum number of connections that are served at a time. Further connections wait.
const CONNECTIONS: usize = 64;

/// Time after which a silent connection is closed.
const PATIENCE: Duration = Duration::from_secs(20);

/// A running explorer. It serves until the process ends.
pub struct Viewer {
    url: String,
    server: oxhttp::ListeningServer,
}

impl Viewer {
    /// Opens stores and starts the server. `port` 0 stands for any free port.
    ///
    /// # Errors
    /// Returns an error if a store cannot be opened, or if the port is in use.
    pub fn start(stores: &[PathBuf], port: u16) -> Result<Self, ViewError> {
        let service = Arc::new(Service::new(stores)?);
        let token = token();
        // The server library does not report the port that it received, so a free port is chosen first.
        // Another process may take the port in the meantime.
        let mut tries = 0;
        loop {
            let failed = |cause| ViewError::Listen { port, cause };
            let chosen = if port == 0 {
                let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).map_err(failed)?;
                listener.local_addr().map_err(failed)?.port()
            } else {
                port
            };
            let access = Access { token: token.clone(), port: chosen };
            let service = service.clone();
            let server = Server::new(move |request| answer(&service, &access, request).into_response())
                .bind((Ipv4Addr::LOCALHOST, chosen))
                .with_global_timeout(PATIENCE)
                .with_max_concurrent_connections(CONNECTIONS)
                .spawn();
            match server {
                Ok(server) => {
                    return Ok(Self { url: format!("http://127.0.0.1:{chosen}/?token={token}"), server });
                }
                Err(_) if port == 0 && tries < 8 => tries += 1,
                Err(cause) => return Err(failed(cause)),
            }
        }
    }

    /// Returns the URL of the page, with the token.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// Serves until the process ends.
    ///
    /// # Errors
    /// Returns an error if the server fails.
    pub fn wait(self) -> std::io::Result<()> {
        self.server.join()
    }
}

/// Returns 128 random bits as text.
fn token() -> String {
    let mut bytes = [0; 16];
    SysRng.try_fill_bytes(&mut bytes).expect("the system has a source of random numbers");
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// What a request must contain.
struct Access {
    token: String,
    port: u16,
}

impl Access {
    /// Returns whether a name of a host, with a port, means this server.
    fn is_own(&self, host: &str) -> bool {
        ["127.0.0.1", "localhost"].iter().any(|name| host == format!("{name}:{}", self.port))
    }

    /// Returns the reason to refuse a request, if there is one.
    fn refusal(&self, request: &Request<Body>, needs_token: bool) -> Option<Answer> {
        let header = |name: &str| request.headers().get(name).and_then(|v| v.to_str().ok());
        // A page of another host whose name resolves to this computer sends its own name (DNS rebinding).
        if !header("host").is_some_and(|host| self.is_own(host)) {
            return Some(Answer::Refused(
                421,
                "the request names another host; open the URL that was printed".into(),
            ));
        }
        let foreign = |origin: &str| !origin.strip_prefix("http://").is_some_and(|host| self.is_own(host));
        if request.headers().contains_key("origin") && header("origin").is_none_or(foreign) {
            return Some(Answer::Refused(403, "the request comes from another page".into()));
        }
        if needs_token && header("x-sunstone-token") != Some(&self.token) {
            let reason = "the token is missing or wrong; open the URL that `sunstone view` printed";
            return Some(Answer::Refused(403, reason.into()));
        }
        None
    }
}

fn answer(service: &Service, access: &Access, request: &mut Request<Body>) -> Answer {
    let path = request.uri().path().to_owned();
    let api = path.strip_prefix("/api/");
    let result = if let Some(refusal) = access.refusal(request, api.is_some()) {
        Ok(Some(refusal))
    } else {
        match (request.method(), api) {
            (&Method::GET, None) => Ok(page::file(&path)),
            (&Method::GET, Some(api)) => service.get(api, request.uri().query().unwrap_or("")),
            (&Method::POST, Some(api)) => match body(request) {
                Ok(body) => service.post(api, &body),
                Err(refusal) => Ok(Some(refusal)),
            },
            _ => Ok(Some(Answer::Refused(405, "the method is not supported".into()))),
        }
    };
    // The library reads the rest of a body, which may be endless. What is left of it is not the next request.
    let is_read = matches!(result, Ok(Some(ref answer)) if !matches!(answer, Answer::Refused(..)));
    if !is_read {
        request.headers_mut().insert("connection", HeaderValue::from_static("close"));
    }
    *request.body_mut() = Body::empty();
    match result {
        Ok(Some(answer)) => answer,
        Ok(None) => Answer::Refused(404, format!("there is no {path}")),
        Err(e) => Answer::Refused(if e.is_of_system() { 500 } else { 400 }, e.to_string()),
    }
}

/// Reads the body of a request.
fn body(request: &mut Request<Body>) -> Result<Vec<u8>, Answer> {
    let mut bytes = vec![];
    let read = request.body_mut().take(LARGEST + 1).read_to_end(&mut bytes);
    if let Err(e) = read {
        return Err(Answer::Refused(400, format!("the request could not be read: {e}")));
    }
    if bytes.len() as u64 > LARGEST {
        return Err(Answer::Refused(413, format!("the request is larger than {LARGEST} bytes")));
    }
    Ok(bytes)
}
