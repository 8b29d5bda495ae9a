//! Assets that are read piece by piece over HTTP on the loopback: the same light for a share of the bytes.

use crate::frame::write_scene;
use glam::DVec3;
use squall_bake::pipeline;
use squall_bake::progress::Quiet;
use squall_bake::recipe::Recipe;
use squall_formats::container;
use squall_runtime::ranges::{Fetched, Opening};
use squall_runtime::relight::PointLight;
use squall_runtime::verify::verify;
use squall_runtime::{Asset, Clouds, RuntimeError};
use std::io::{BufRead, BufReader, Error, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// Most of an asset's bytes that one flash may cost.
const SHARE_OF_ONE_FLASH: f64 = 0.15;
const VIEWER: DVec3 = DVec3::new(0.0, 0.0, 2.0);
const LIGHT: [PointLight; 1] = [PointLight { position: DVec3::new(40.0, 3010.0, 1120.0), intensity: 1e6 }];

const RECIPE: &str = r#"
[clouds]
scene = "ball.json"
[clouds.lightning]
spacing_m = 250.0
prune = false
[clouds.response]
distant = ["upper-sky"]
channels = "harmonics-3"
codec = "bytes"
test_strokes = 0
"#;

/// A ball of cloud and a virtual light every 250 m: nearly all of its bytes are rows.
fn file() -> &'static Arc<Vec<u8>> {
    static BAKED: OnceLock<Arc<Vec<u8>>> = OnceLock::new();
    BAKED.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        write_scene(folder.path());
        let recipe = folder.path().join("lights.toml");
        std::fs::write(&recipe, RECIPE).unwrap();
        let sections = pipeline::bake(&Recipe::read(&recipe).unwrap(), &Quiet).unwrap().sections;
        let mut bytes = Vec::new();
        container::write(&mut bytes, &sections).unwrap();
        Arc::new(bytes)
    })
}

fn radiance(asset: &Asset) -> Result<Vec<f32>, RuntimeError> {
    let mut clouds = Clouds::new(asset)?;
    let mut values = vec![0.0; clouds.cloud().shape.len()];
    clouds.light(&LIGHT)?.radiance(VIEWER, &mut values)?;
    Ok(values)
}

fn part(bytes: &[u8], range: Range<u64>) -> &[u8] {
    &bytes[range.start as usize..range.end.min(bytes.len() as u64) as usize]
}

/// A server that answers GET on the loopback until the test ends, and counts the bytes of bodies that it sends.
struct Server {
    address: SocketAddr,
    sent: Arc<AtomicU64>,
}

impl Server {
    fn start(file: Arc<Vec<u8>>, knows_ranges: bool) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let (address, sent) = (listener.local_addr().unwrap(), Arc::new(AtomicU64::new(0)));
        let counted = sent.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let mut lines = BufReader::new(stream.try_clone().unwrap()).lines().map_while(Result::ok);
                let lines: Vec<String> = lines.by_ref().take_while(|line| !line.is_empty()).collect();
                let asked = lines.iter().find_map(|line| line.strip_prefix("Range: bytes="));
                let range = asked.filter(|_| knows_ranges).and_then(|range| range.split_once('-'));
                let range = range.map(|(from, to)| from.parse().unwrap()..to.parse::<u64>().unwrap() + 1);
                let status = if range.is_some() { "206 Partial Content" } else { "200 OK" };
                let body = part(&file, range.unwrap_or(0..file.len() as u64));
                counted.fetch_add(body.len() as u64, Ordering::Relaxed);
                let head = format!("HTTP/1.1 {status}\r\nContent-Length: {}\r\n\r\n", body.len());
                let _ = (&stream).write_all(&[head.as_bytes(), body].concat());
            }
        });
        Self { address, sent }
    }

    fn open(&self) -> Result<Asset, RuntimeError> {
        let address = self.address;
        Asset::open_range("http://storm", move |range: Range<u64>| {
            let mut stream = TcpStream::connect(address)?;
            write!(stream, "GET / HTTP/1.1\r\nRange: bytes={}-{}\r\n\r\n", range.start, range.end - 1)?;
            let mut answer = Vec::new();
            stream.read_to_end(&mut answer)?;
            let end = answer.windows(4).position(|four| four == b"\r\n\r\n").ok_or(ErrorKind::InvalidData)?;
            let body = answer.split_off(end + 4);
            Ok(if answer.starts_with(b"HTTP/1.1 206") { Fetched::Part(body) } else { Fetched::Whole(body) })
        })
    }
}

#[test]
fn one_flash_over_http_costs_a_share_of_the_asset_and_gives_the_same_light() {
    let file = file();
    let server = Server::start(file.clone(), true);
    let asset = server.open().unwrap();
    let opened = server.sent.load(Ordering::Relaxed);
    let lit = radiance(&asset).unwrap();
    assert!(lit == radiance(&Asset::from_bytes(file).unwrap()).unwrap());
    let sent = server.sent.load(Ordering::Relaxed);
    assert_eq!(asset.fetched_bytes(), Some(sent));
    println!("{opened} bytes to open, {} for a flash, of {}", sent - opened, file.len());
    assert!(sent as f64 <= SHARE_OF_ONE_FLASH * file.len() as f64, "{sent} of {}", file.len());
    // What came once is not asked for again.
    assert!(radiance(&asset).unwrap() == lit);
    assert_eq!(server.sent.load(Ordering::Relaxed), sent);
}

#[test]
fn where_a_server_knows_no_ranges_the_whole_file_comes_once() {
    let file = file();
    let server = Server::start(file.clone(), false);
    let asset = server.open().unwrap();
    assert!(radiance(&asset).unwrap() == radiance(&Asset::from_bytes(file).unwrap()).unwrap());
    assert_eq!((asset.fetched_bytes(), server.sent.load(Ordering::Relaxed)), (None, file.len() as u64));
}

#[test]
fn without_a_reader_a_call_names_the_bytes_that_it_lacks_and_goes_on_with_them() {
    let file = file();
    let mut opening = Opening::new("storm");
    while let Some(range) = opening.wanted() {
        opening.give(range.start, part(file, range.clone())).unwrap();
    }
    let asset = opening.finish().unwrap();
    let Err(RuntimeError::NotFetched { ranges, .. }) = radiance(&asset) else { panic!("rows are missing") };
    for range in ranges {
        asset.give(range.start, part(file, range.clone())).unwrap();
    }
    assert!(radiance(&asset).unwrap() == radiance(&Asset::from_bytes(file).unwrap()).unwrap());
    assert!(verify(&asset).unwrap_err().to_string().contains("read piece by piece"));
}

#[test]
fn damage_is_found_as_it_comes_and_a_failed_request_may_be_made_again() {
    let file = file();
    let whole = Asset::from_bytes(file).unwrap();
    let rows = whole.directory().entries.iter().max_by_key(|entry| entry.length).unwrap();
    let (rows_from, length) = (rows.offset + rows.head_length, file.len() as u64);
    let (bytes, fails) = (file.clone(), AtomicU64::new(1));
    let asset = Asset::open_range("storm", move |range: Range<u64>| {
        let mut bytes = part(&bytes, range.clone()).to_vec();
        if range.start >= rows_from && range.start < length {
            match fails.fetch_add(1, Ordering::Relaxed) {
                1 => return Err(Error::other("line cut")),
                2 => bytes[7] ^= 1,
                3 => bytes.truncate(9),
                _ => {}
            }
        }
        Ok(Fetched::Part(bytes))
    });
    let asset = asset.unwrap();
    let error = |asset: &Asset| radiance(asset).unwrap_err().to_string();
    assert_eq!(error(&asset), "storm: cannot read: line cut");
    let damaged = error(&asset);
    assert!(damaged.contains("checksum"), "{damaged}");
    let short = error(&asset);
    assert!(short.contains("9 bytes of"), "{short}");
    assert!(radiance(&asset).unwrap() == radiance(&whole).unwrap());
}

#[test]
fn starts_that_are_no_assets_are_refused_with_bounded_work() {
    let open = |bytes: Vec<u8>| {
        let read = move |range: Range<u64>| Ok(Fetched::Part(part(&bytes, range).to_vec()));
        Asset::open_range("storm", read).unwrap_err().to_string()
    };
    assert!(open(Vec::new()).starts_with("storm:"));
    assert!(open(b"<!DOCTYPE html>".to_vec()).contains("HTML"), "{}", open(b"<!DOCTYPE html>".to_vec()));
    let mut long = file()[..5000].to_vec();
    long[16..24].copy_from_slice(&u64::MAX.to_le_bytes());
    assert!(open(long.clone()).contains("the header says 18446744073709551615 bytes"));
    long[16..24].copy_from_slice(&(1u64 << 30).to_le_bytes());
    assert!(open(long).contains("header checksum"));
    let mut cut = Opening::new("storm");
    assert!(cut.give(1, &[0]).unwrap_err().to_string().contains("range"));
}
