//! Clients of object stores: Amazon S3 and compatible servers, Google Cloud Storage, Azure Blob Storage, and
//! web servers (read-only).
//!
//! Calls block the calling thread. Requests run on a runtime with two threads, and the requests of one
//! call are concurrent. Requests that fail temporarily (HTTP status 5xx, closed connection) are repeated.
//! Credentials, endpoint and region come from the environment variables of each cloud.

mod client;
#[cfg(test)]
mod tests;

use object_store::aws::AmazonS3Builder;
use object_store::azure::MicrosoftAzureBuilder;
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::http::HttpBuilder;
use object_store::path::Path as Key;
use object_store::{BackoffConfig, ClientOptions, Error, ObjectStore, RetryConfig};
use std::fmt;
use std::path::Path;
use std::sync::{Arc, LazyLock, Once, mpsc};
use std::time::{Duration, Instant};
use store::refusal::Refusal;
use tokio::runtime::{Builder, Runtime};

/// Maximum number of concurrent requests.
const AT_ONCE: usize = 32;
/// Maximum number of attempts of a request.
const ATTEMPTS: usize = 6;
/// Pause before the first retry.
const PAUSE: Duration = Duration::from_millis(if cfg!(test) { 1 } else { 50 });
/// Maximum total time of the retries in this crate. The client library itself retries longer failures, with
/// increasing pauses.
const PATIENCE: Duration = Duration::from_secs(10);
static RUNTIME: LazyLock<std::io::Result<Runtime>> = LazyLock::new(|| {
    Builder::new_multi_thread().worker_threads(2).thread_name("objects").enable_all().build()
});

/// Waits for a future on the runtime. Threads of another runtime must not call `block_on`.
fn wait<T: Send + 'static>(future: impl Future<Output = T> + Send + 'static) -> Result<T, Refusal> {
    let runtime = RUNTIME.as_ref().map_err(|e| {
        Refusal::new(format!("cannot create threads for requests: {e}"), "close other programs")
    })?;
    let (tell, message) = mpsc::sync_channel(1);
    runtime.spawn(async move {
        let _ = tell.send(future.await);
    });
    message.recv().map_err(|_| Refusal::new("the request was interrupted", "try again"))
}

/// The objects below a URL, with the client of the object store.
#[derive(Clone)]
struct Objects {
    scheme: String,
    store: Arc<dyn ObjectStore>,
    below: Key,
}

/// Formats the URL only, because the client contains credentials.
impl fmt::Debug for Objects {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Objects({}://.. {})", self.scheme, self.below)
    }
}

impl Objects {
    fn open(scheme: &str, address: &Path) -> Result<Self, Refusal> {
        let whole = address.to_str().unwrap_or_default().trim_end_matches('/');
        let rest = whole.split_once("://").map_or("", |(_, rest)| rest);
        let (host, path) = rest.split_once('/').unwrap_or((rest, ""));
        if host.is_empty() {
            return Err(Refusal::new(
                "the address contains no name of a bucket or server",
                format!("write {scheme}://NAME/STORE.zarr"),
            ));
        }
        provider();
        let store: Result<Arc<dyn ObjectStore>, Error> = match scheme {
            "s3" => AmazonS3Builder::from_env()
                .with_bucket_name(host)
                .with_retry(retry())
                .build()
                .map(|s| Arc::new(s) as _),
            "gs" => GoogleCloudStorageBuilder::from_env()
                .with_bucket_name(host)
                .with_retry(retry())
                .build()
                .map(|s| Arc::new(s) as _),
            "az" => MicrosoftAzureBuilder::from_env()
                .with_container_name(host)
                .with_retry(retry())
                .build()
                .map(|s| Arc::new(s) as _),
            "http" | "https" if whole.contains(['?', '#']) => {
                return Err(Refusal::new(
                    "an address with `?` or `#` refers to one file, but a store has many files",
                    "use the address of the store's folder",
                ));
            }
            "http" | "https" => HttpBuilder::new()
                .with_url(whole)
                .with_client_options(ClientOptions::new().with_allow_http(true))
                .with_retry(retry())
                .build()
                .map(|s| Arc::new(s) as _),
            #[cfg(test)]
            "memory" => Ok(tests::memory(host)),
            #[cfg(test)]
            "flaky" | "mortal" => Ok(tests::faulty::faulty(scheme, host)),
            _ => {
                return Err(Refusal::new(
                    format!("unknown address scheme {scheme}://"),
                    "use s3://, gs://, az://, http:// or https://, or a local path",
                ));
            }
        };
        let path = if scheme.starts_with("http") { "" } else { path };
        Ok(Self {
            scheme: scheme.to_owned(),
            below: Key::parse(path).map_err(|e| {
                Refusal::new(format!("the path is not valid for an object: {e}"), "choose another path")
            })?,
            store: store.map_err(|e| refusal(scheme, &e))?,
        })
    }

    fn key(&self, key: &str) -> Key {
        key.split('/').fold(self.below.clone(), Key::join)
    }

    fn refusal(&self, error: &Error) -> Refusal {
        refusal(&self.scheme, error)
    }
}

/// Registers the clients of this crate in the process, for every path with a scheme (`s3://`, `gs://`,
/// `az://`, `http://`, `https://`).
pub fn install() {
    store::objects::install(|scheme, address| Ok(Arc::new(Objects::open(scheme, address)?)));
}

/// Installs the cryptography provider of HTTPS, unless the program has installed one.
fn provider() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let _ = rustls::crypto::ring::default_provider().install_default();
    });
}

fn retry() -> RetryConfig {
    RetryConfig {
        backoff: BackoffConfig { init_backoff: PAUSE, max_backoff: Duration::from_secs(5), base: 2.0 },
        max_retries: 8,
        retry_timeout: Duration::from_secs(60),
    }
}

/// Repeats an idempotent request whose response was lost or truncated. The client library does not repeat
/// requests that change objects.
async fn again<T, F: Future<Output = Result<T, Error>>>(mut ask: impl FnMut() -> F) -> Result<T, Error> {
    let begun = Instant::now();
    let mut pause = PAUSE;
    for _ in 1..ATTEMPTS {
        match ask().await {
            Err(Error::Generic { .. }) if begun.elapsed() < PATIENCE => {}
            result => return result,
        }
        tokio::time::sleep(pause).await;
        pause *= 2;
    }
    ask().await
}

/// Formats an error together with all its causes.
fn chain(error: &Error) -> String {
    let mut text = error.to_string();
    let mut next = std::error::Error::source(error);
    while let Some(cause) = next {
        let more = cause.to_string();
        if !text.contains(&more) {
            text = format!("{text}: {more}");
        }
        next = cause.source();
    }
    text
}

/// Returns the environment variables for the credentials of a scheme, for anonymous access, and for the
/// server's URL.
fn variables(scheme: &str) -> [&'static str; 3] {
    match scheme {
        "gs" => ["GOOGLE_APPLICATION_CREDENTIALS", "GOOGLE_SKIP_SIGNATURE=true", "GOOGLE_BASE_URL"],
        "az" => [
            "AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE_ACCOUNT_KEY",
            "AZURE_SKIP_SIGNATURE=true",
            "AZURE_ENDPOINT",
        ],
        _ => ["AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY", "AWS_SKIP_SIGNATURE=true", "AWS_ENDPOINT"],
    }
}

/// Converts an error of the client library to a [`Refusal`], which states the fault and the fix.
fn refusal(scheme: &str, error: &Error) -> Refusal {
    let text = chain(error);
    let says = |words: &[&str]| words.iter().any(|word| text.contains(word));
    let [credentials, public, server] = variables(scheme);
    let web = scheme.starts_with("http");
    if says(&["NoSuchBucket", "ContainerNotFound"]) {
        return Refusal::new(
            "the bucket does not exist",
            format!("check the name of the bucket, and {server} if you use your own server"),
        );
    }
    if says(&["169.254.169.254", "metadata.google", "MissingCredential", "Account must be"]) {
        return Refusal::new(
            "no credentials found",
            format!("set {credentials}, or {public} for public data"),
        );
    }
    if says(&["scheme is not allowed", "HTTP URLs are not", "AllowHttp"]) {
        return Refusal::new(
            "the server address uses http://, which is not encrypted",
            "set AWS_ALLOW_HTTP=true for your own server, or use https://",
        );
    }
    if says(&["501 ", "not supported", "not implemented", "not yet implemented"]) {
        return Refusal::new(
            "the server does not support this request",
            "use an object store (s3://, gs://, az://)",
        );
    }
    if says(&["301 Moved", "PermanentRedirect", "AuthorizationHeaderMalformed", "bare redirect"]) {
        return Refusal::new("the bucket is in another region", "set AWS_REGION to the region of the bucket");
    }
    if matches!(error, Error::Unauthenticated { .. } | Error::PermissionDenied { .. })
        || says(&["InvalidAccessKeyId", "SignatureDoesNotMatch", "AccessDenied"])
    {
        return Refusal::new(
            "the server denies access",
            if web {
                "ask the server's administrator for read access".to_owned()
            } else {
                format!(
                    "check {credentials} and their permissions, and check that the bucket exists (without permission to list, a missing \
                     bucket also gives this error)"
                )
            },
        );
    }
    if says(&["timed out"]) {
        return Refusal::new("the server did not respond in time", "try again, or check the network");
    }
    if says(&["error sending request", "Connect", "dns error", "connection"]) {
        return Refusal::new(
            "cannot connect to the server",
            if web {
                "check the address and the network".to_owned()
            } else {
                format!("check the network, and {server} if you use your own server")
            },
        );
    }
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    Refusal::new(
        format!("the server refused the request: {line}"),
        "check the address and your access rights",
    )
}
