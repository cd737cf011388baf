//! Who may speak over a line that anybody can reach.

use crate::input;
use crate::stop::Stop;
use bond::exchange::Key;
use std::net::{IpAddr, SocketAddr};
use std::path::Path;

/// An address, with any port or with one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Peer {
    ip: IpAddr,
    port: Option<u16>,
}

impl Peer {
    /// Whether a datagram from there is its.
    pub fn is_at(&self, from: SocketAddr) -> bool {
        self.ip == from.ip().to_canonical() && self.port.is_none_or(|port| port == from.port())
    }

    /// Where it is, if its port is known, as a socket of either kind of addresses reaches it.
    pub fn place(&self, is_v6: bool) -> Option<SocketAddr> {
        let ip = match self.ip {
            IpAddr::V4(ip) if is_v6 => IpAddr::V6(ip.to_ipv6_mapped()),
            ip => ip,
        };
        self.port.map(|port| SocketAddr::new(ip, port))
    }
}

impl std::str::FromStr for Peer {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let whole = text.parse::<SocketAddr>().map(|a| (a.ip(), Some(a.port())));
        let (ip, port) = whole.or_else(|_| text.parse::<IpAddr>().map(|ip| (ip, None))).map_err(|_| {
            "write an IP address, with or without a port, such as 10.0.0.2 or 10.0.0.2:7001; names are not looked up"
        })?;
        Ok(Self { ip: ip.to_canonical(), port })
    }
}

/// Reads a key.
///
/// # Errors
/// A file that cannot be read, or that holds no key.
pub fn key(path: &Path) -> Result<Key, Stop> {
    let bytes = std::fs::read(path).map_err(|e| input::unreadable(path, &e))?;
    Key::read(&bytes).map_err(|e| Stop::Usage(format!("{} is no key: {e}", input::name(path))))
}

/// Refuses to listen where strangers can reach it and nothing tells them from the device.
///
/// # Errors
/// Status 2, with the ways out.
pub fn is_told_from_strangers(address: SocketAddr, is_known: bool) -> Result<(), Stop> {
    if is_known || address.ip().to_canonical().is_loopback() {
        return Ok(());
    }
    let port = address.port();
    Err(Stop::Usage(format!(
        "--udp {address} can be reached from other machines: say which device may speak, with --key-file FILE (it has \
        the same key) or --peer ADDRESS (it is there), or listen on this machine alone, with --udp 127.0.0.1:{port}"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_peer_is_an_address_with_any_port_or_one() {
        let peer = |text: &str| text.parse::<Peer>().unwrap();
        let at = |text: &str| text.parse::<SocketAddr>().unwrap();
        assert!(peer("10.0.0.2").is_at(at("10.0.0.2:1")) && peer("10.0.0.2").is_at(at("10.0.0.2:65535")));
        assert!(peer("10.0.0.2:7").is_at(at("10.0.0.2:7")) && !peer("10.0.0.2:7").is_at(at("10.0.0.2:8")));
        assert!(!peer("10.0.0.2").is_at(at("10.0.0.3:7")));
        // As a socket for both kinds of addresses sees it.
        assert!(peer("10.0.0.2").is_at(at("[::ffff:10.0.0.2]:7")) && peer("[::1]:7").is_at(at("[::1]:7")));
        assert!("device:7".parse::<Peer>().is_err());
    }

    #[test]
    fn only_loopback_needs_no_peer_and_no_key() {
        let open = |text: &str| is_told_from_strangers(text.parse().unwrap(), false).is_ok();
        assert!(open("127.0.0.1:7") && open("127.3.2.1:7") && open("[::1]:7") && open("[::ffff:127.0.0.1]:7"));
        assert!(!open("0.0.0.0:7") && !open("[::]:7") && !open("192.168.0.1:7"));
        assert!(is_told_from_strangers("0.0.0.0:7".parse().unwrap(), true).is_ok());
    }
}
