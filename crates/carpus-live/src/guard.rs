//! Who may ask, and what browsers may do with the answers.
//!
//! Every request has to come to this machine under one of its own names (a page elsewhere whose name was made to lead
//! here does not), and to know the token. A browser gets it once, with the address that the server prints, as a cookie
//! that scripts cannot read and that no other site's requests carry. What acts has to come from a page of this server:
//! its `Origin` is the host it asks. There are no headers that would allow other origins anything.

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, COOKIE, HOST, HeaderName, ORIGIN, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::state::Live;

/// Bytes of a token: 128 random bits cannot be guessed.
const TOKEN_BYTES: usize = 16;

/// What the page itself may do: its own script and style, requests to this server, frames with this server's files.
const PAGE_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
                           frame-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; \
                           frame-ancestors 'none'";

/// What results may do, beside what their own policy allows: scripts run without any access to this server, in a frame
/// of the page or by themselves.
pub(crate) const RESULT_POLICY: &str = "sandbox allow-scripts allow-downloads; base-uri 'none'; form-action 'none'; \
                                        frame-ancestors 'self'";

/// Names of this machine, as requests to it have them.
const NAMES: [&str; 3] = ["127.0.0.1", "localhost", "[::1]"];

/// A new token, in hexadecimal digits.
///
/// # Errors
/// The system has no random numbers.
pub(crate) fn new_token() -> Result<String, getrandom::Error> {
    let mut bytes = [0; TOKEN_BYTES];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The cookie with the token. Servers on other ports have the same cookies: the name tells them apart.
pub(crate) fn cookie(live: &Live) -> String {
    format!("{}={}; Path=/; HttpOnly; SameSite=Strict", cookie_name(live), live.token)
}

fn cookie_name(live: &Live) -> String {
    format!("carpus_live_{}", live.port)
}

/// Answers requests of those who may ask.
pub(crate) async fn guard(State(live): State<Arc<Live>>, request: Request, next: Next) -> Response {
    let mut response = match refusal(&live, &request) {
        Some(why) => (StatusCode::FORBIDDEN, format!("{why}\n")).into_response(),
        None => next.run(request).await,
    };
    let headers = response.headers_mut();
    let all = [
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (REFERRER_POLICY, "no-referrer"),
        (CACHE_CONTROL, "no-store"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    ];
    all.into_iter().for_each(|(name, value)| drop(headers.insert(name, HeaderValue::from_static(value))));
    // Results are in a sandbox, which browsers do not open under such a policy.
    if !headers.contains_key(CONTENT_SECURITY_POLICY) {
        headers.insert(HeaderName::from_static("cross-origin-opener-policy"), HeaderValue::from_static("same-origin"));
    }
    headers.entry(CONTENT_SECURITY_POLICY).or_insert(HeaderValue::from_static(PAGE_POLICY));
    response
}

/// Why a request is not answered; `None`: it is.
fn refusal(live: &Live, request: &Request) -> Option<&'static str> {
    let headers = request.headers();
    let Some(host) = only(headers, &HOST).filter(|host| is_this_machine(host)) else {
        return Some("this server answers to 127.0.0.1 and localhost only");
    };
    let is_reading = [Method::GET, Method::HEAD].contains(request.method());
    if !is_reading && only(headers, &ORIGIN) != Some(&format!("http://{host}")) {
        return Some("only a page of this server may ask for this");
    }
    let knows = cookies(headers, &cookie_name(live)).any(|value| is_same(value, &live.token))
        || request.uri().path() == "/"
            && in_query(request.uri().query()).is_some_and(|value| is_same(value, &live.token));
    (!knows).then_some("open the address that carpus live printed: it has the token")
}

/// The one value of a header; `None`: there is none, or there are several.
fn only<'h>(headers: &'h HeaderMap, name: &HeaderName) -> Option<&'h str> {
    let mut values = headers.get_all(name).iter();
    let value = values.next()?.to_str().ok()?;
    values.next().is_none().then_some(value)
}

/// Whether a host is a name of this machine, on any port: that of a tunnel may be another one.
fn is_this_machine(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if !port.is_empty() && port.bytes().all(|b| b.is_ascii_digit()) => name,
        _ => host,
    };
    NAMES.iter().any(|own| own.eq_ignore_ascii_case(name))
}

/// Values of the cookies of a name.
fn cookies<'h>(headers: &'h HeaderMap, name: &str) -> impl Iterator<Item = &'h str> {
    let all = headers.get_all(COOKIE).iter().filter_map(|value| value.to_str().ok()).flat_map(|text| text.split(';'));
    all.filter_map(|pair| pair.trim().split_once('=')).filter(move |(of, _)| *of == name).map(|(_, value)| value)
}

/// The token of an address.
fn in_query(query: Option<&str>) -> Option<&str> {
    query?.split('&').find_map(|pair| pair.strip_prefix("token="))
}

/// Whether two texts are the same, in a time that does not tell how far they are.
fn is_same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |differ, (x, y)| differ | (x ^ y)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_only_names_of_this_machine() {
        for host in ["127.0.0.1", "127.0.0.1:80", "LOCALHOST:9000", "[::1]:1", "[::1]"] {
            assert!(is_this_machine(host), "{host}");
        }
        for host in ["", "evil.example", "127.0.0.1.evil.example", "localhost.", "127.0.0.1:", "localhost:80:90", "::1"]
        {
            assert!(!is_this_machine(host), "{host}");
        }
    }

    #[test]
    fn verif_tokens_have_128_bits_and_differ() {
        let [a, b] = [new_token().unwrap(), new_token().unwrap()];
        assert_eq!((a.len(), a.bytes().all(|c| c.is_ascii_hexdigit())), (32, true));
        assert!(a != b && is_same(&a, &a.clone()) && !is_same(&a, &b) && !is_same(&a, &a[1..]));
    }

    #[test]
    fn verif_tokens_are_found_in_cookies_and_addresses() {
        let mut headers = HeaderMap::new();
        headers.append(COOKIE, HeaderValue::from_static("a=1; carpus_live_1=x; carpus_live_2=y"));
        assert_eq!(cookies(&headers, "carpus_live_2").collect::<Vec<_>>(), ["y"]);
        assert_eq!(in_query(Some("b=2&token=abc")), Some("abc"));
        assert_eq!((in_query(Some("xtoken=abc")), in_query(None)), (None, None));
    }
}
