//! The page that plays an asset, in a browser without a screen: it loads, strikes, and shows the pictures that a native program draws.

use crate::wasm::module;
use crate::{root, skip};
use serde_json::Value;
use squall_page::Player;
use squall_runtime::frame::FrameQuality;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

/// What page, scripts and module may take in all, bytes.
const LARGEST_PAGE: u64 = 2_000_000;
/// What a browser may take to load, draw four pictures and tell, on a busy machine.
const PATIENCE: Duration = Duration::from_secs(300);
/// How far a pixel may differ between the module and this build, of 255: nothing, both do the same operations in the same order.
/// Other architectures may add four lanes in another order, which is a step at most.
const DIFFERENCE: u8 = if cfg!(target_arch = "x86_64") { 0 } else { 1 };

/// What the page does by itself here: draws, rains, strikes by a call and by a key, and tells.
const TEST_SCRIPT: &str = r#"
const told = { errors: window.errors, frames: [] };
const keep = () => {
  const { width, height, pixels } = squall.frame();
  let text = "";
  for (const byte of pixels) text += String.fromCharCode(byte);
  told.frames.push({ width, height, pixels: btoa(text) });
};
try {
  await squall.ready;
  keep();
  await squall.set({ rate_mm_per_h: 45, fov_deg: 40 });
  keep();
  await squall.strike(0.5, 0.4);
  keep();
  try {
    await squall.set({ rate_mm_per_h: -1 });
  } catch (error) {
    told.refused = error.message;
  }
  await squall.set({ overcast: 0.5 });
  const status = document.getElementById("status");
  const before = status.textContent;
  document.getElementById("picture").dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" }));
  const heading = () => document.querySelector("[name=heading_deg]").value;
  const from = heading();
  while (heading() === from) await new Promise((resolve) => setTimeout(resolve, 20));
  told.status = status.textContent;
  told.backend = document.getElementById("backend").textContent;
  told.fits = document.documentElement.scrollWidth <= innerWidth;
  told.unnamed = [...document.querySelectorAll("input, button, canvas")].filter(
    (part) => !(part.ariaLabel || part.textContent.trim() || part.labels?.[0]?.textContent.trim())).length;
  told.canvas = document.getElementById("picture").width;
} catch (error) {
  told.errors.push(String(error));
}
await fetch("/told", { method: "POST", body: JSON.stringify(told) });
"#;

/// Put before the page's own scripts: what goes wrong is told, and the page is not loaded before it has told.
const PREFACE: &str = r#"<script>
window.errors = [];
addEventListener("error", (event) => errors.push(event.message));
addEventListener("unhandledrejection", (event) => errors.push(String(event.reason)));
const error = console.error;
console.error = (...words) => { errors.push(words.join(" ")); error(...words); };
</script><img src="/hold" alt="" hidden>"#;

fn browser() -> Option<&'static str> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let found = names.into_iter().find(|name| Command::new(name).arg("--version").output().is_ok());
    if found.is_none() {
        skip("SQUALL_REQUIRE_BROWSER", "no browser");
    }
    found
}

/// The page's own files and a module, in a folder, as `squall page` writes them.
fn folder(module: &Path, asset: &Path) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["index.html", "page.css", "page.js", "gpu.js", "worker.js"] {
        std::fs::copy(root().join("runtime/page/web").join(name), folder.path().join(name)).unwrap();
    }
    std::fs::copy(module, folder.path().join("squall_page.wasm")).unwrap();
    std::fs::copy(asset, folder.path().join("asset.squall")).unwrap();
    folder
}

/// Serves a folder on the loopback until the test ends; what the page tells comes out of the receiver.
fn serve(folder: &Path, script: &str) -> (u16, Receiver<Value>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let (send, receive) = channel();
    let (folder, told) = (folder.to_owned(), Arc::new((Mutex::new(false), Condvar::new())));
    let script: Arc<str> = script.into();
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let (folder, told, send, script) = (folder.clone(), told.clone(), send.clone(), script.clone());
            std::thread::spawn(move || {
                let (path, range, body) = request(&stream);
                match path.as_str() {
                    "/told" => {
                        answer(&stream, "200 OK", "text/plain", b"");
                        let _ = send.send(serde_json::from_slice(&body).unwrap_or(Value::Null));
                        *told.0.lock().unwrap() = true;
                        told.1.notify_all();
                    }
                    // The browser looks at the page when everything has loaded: this is, when the page has told.
                    "/hold" => {
                        let waited = told.1.wait_while(told.0.lock().unwrap(), |told| !*told);
                        drop(waited);
                        answer(&stream, "404 Not Found", "text/plain", b"");
                    }
                    "/test.js" => answer(&stream, "200 OK", "text/javascript", script.as_bytes()),
                    _ => file(&stream, &folder, &path, range),
                }
            });
        }
    });
    (port, receive)
}

/// Path, range and body of a request.
fn request(stream: &TcpStream) -> (String, Option<[usize; 2]>, Vec<u8>) {
    let mut reader = BufReader::new(stream);
    let (mut first, mut range, mut length) = (String::new(), None, 0);
    reader.read_line(&mut first).unwrap();
    loop {
        let mut line = String::new();
        reader.read_line(&mut line).unwrap();
        let (name, value) = line.trim().split_once(": ").unwrap_or_default();
        match name.to_ascii_lowercase().as_str() {
            "" => break,
            "content-length" => length = value.parse().unwrap(),
            "range" => {
                let ends = value.strip_prefix("bytes=").and_then(|ends| ends.split_once('-'));
                range = ends.map(|(from, to)| [from.parse().unwrap(), to.parse().unwrap()]);
            }
            _ => {}
        }
    }
    let mut body = vec![0; length];
    reader.read_exact(&mut body).unwrap();
    (first.split(' ').nth(1).unwrap_or_default().to_owned(), range, body)
}

fn answer(mut stream: &TcpStream, status: &str, kind: &str, body: &[u8]) {
    let length = body.len();
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
    );
    let _ = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(body));
}

fn file(stream: &TcpStream, folder: &Path, path: &str, range: Option<[usize; 2]>) {
    let name = if path == "/" { "index.html" } else { path.trim_start_matches('/') };
    let Ok(mut bytes) = std::fs::read(folder.join(name)) else {
        return answer(stream, "404 Not Found", "text/plain", b"");
    };
    let kind = match name.rsplit('.').next() {
        Some("html") => "text/html",
        Some("css") => "text/css",
        Some("js") => "text/javascript",
        Some("wasm") => "application/wasm",
        _ => "application/octet-stream",
    };
    if name == "index.html" {
        let text = String::from_utf8(bytes).unwrap();
        let test = "<script type=\"module\" src=\"test.js\"></script></html>";
        bytes = text.replace("<main>", &format!("{PREFACE}<main>")).replace("</html>", test).into_bytes();
    }
    match range {
        Some([from, to]) => {
            answer(stream, "206 Partial Content", kind, &bytes[from..(to + 1).min(bytes.len())]);
        }
        None => answer(stream, "200 OK", kind, &bytes),
    }
}

/// No graphics card for a page.
const WITHOUT_CARD: [&str; 1] = ["--disable-gpu"];
/// WebGPU on the browser's own adapter in software.
const WITH_CARD: [&str; 3] =
    ["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader", "--enable-features=Vulkan"];

/// What the page tells in a window of some width; with `SQUALL_SCREENSHOT` set to a folder, a picture of it goes there. `query` belongs
/// to its address.
fn played(
    browser: &str,
    (folder, query): (&Path, &str),
    width: u32,
    (flags, script): (&[&str], &str),
) -> Value {
    let (port, told) = serve(folder, script);
    let profile = tempfile::tempdir().unwrap();
    let picture =
        std::env::var_os("SQUALL_SCREENSHOT").map_or_else(|| profile.path().to_owned(), PathBuf::from);
    let mut shown = Command::new(browser)
        .args(["--headless=new", "--no-sandbox", "--hide-scrollbars"])
        .args(flags)
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--screenshot={}", picture.join(format!("page-{width}.png")).display()))
        .arg(format!("--window-size={width},760"))
        .arg(format!("http://127.0.0.1:{port}/{query}"))
        .stderr(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let answer = told.recv_timeout(PATIENCE);
    if answer.is_err() {
        let _ = shown.kill();
    }
    let _ = shown.wait();
    answer.expect("the page told nothing")
}

/// Bytes of base64 text.
fn from_base64(text: &str) -> Vec<u8> {
    let digit = |byte: u8| match byte {
        b'A'..=b'Z' => byte - b'A',
        b'a'..=b'z' => byte - b'a' + 26,
        b'0'..=b'9' => byte - b'0' + 52,
        b'+' => 62,
        _ => 63,
    };
    let digits: Vec<u32> =
        text.bytes().filter(|&byte| byte != b'=').map(|byte| u32::from(digit(byte))).collect();
    let group = |four: &[u32]| {
        let bits = four.iter().enumerate().fold(0, |bits, (i, digit)| bits | digit << (18 - 6 * i));
        bits.to_be_bytes()[1..four.len()].to_vec()
    };
    digits.chunks(4).flat_map(group).collect()
}

/// The pictures that a page told of, each with what a native program's processor draws at this quality.
fn pictures(told: &Value, asset: &Path, quality: FrameQuality) -> Vec<(Vec<u8>, Vec<u8>)> {
    let mut player = Player::default();
    player.open_whole(&std::fs::read(asset).unwrap()).unwrap();
    player.set_quality(quality).unwrap();
    let pair = |(at, frame): (usize, &Value)| {
        let [width, height] = ["width", "height"].map(|side| frame[side].as_u64().unwrap() as u32);
        match at {
            1 => {
                player.set("rate_mm_per_h", 45.0).unwrap();
                player.set("fov_deg", 40.0).unwrap();
            }
            2 => drop(player.strike(0.5, 0.4).unwrap()),
            _ => {}
        }
        let wanted = player.draw(width, height).unwrap().to_vec();
        (from_base64(frame["pixels"].as_str().unwrap()), wanted)
    };
    told["frames"].as_array().unwrap().iter().enumerate().map(pair).collect()
}

/// What a page tells however it draws.
fn check(told: &Value) {
    assert_eq!(told["errors"], Value::Array(Vec::new()), "{told}");
    assert_eq!((&told["fits"], &told["unnamed"]), (&Value::Bool(true), &Value::from(0)));
    assert_eq!(told["refused"], "rate_mm_per_h: wanted 0 to 200, found -1");
    assert!(told["status"].as_str().unwrap().contains(" px in "), "{}", told["status"]);
}

#[test]
fn a_browser_without_a_card_loads_strikes_and_shows_the_pictures_of_a_native_program() {
    let (Some(module), Some(browser)) = (module("squall-page", "page"), browser()) else { return };
    let asset = root().join("data/golden/v1/golden.squall");
    let folder = folder(&module, &asset);
    let own = folder.path().read_dir().unwrap().map(|file| file.unwrap());
    let bytes: u64 = own
        .filter(|file| file.file_name() != "asset.squall")
        .map(|file| file.metadata().unwrap().len())
        .sum();
    assert!(bytes <= LARGEST_PAGE, "{bytes} bytes");

    // A desk's screen and a telephone's.
    for width in [1200, 500] {
        let told = played(browser, (folder.path(), ""), width, (&WITHOUT_CARD, TEST_SCRIPT));
        check(&told);
        let backend = told["backend"].as_str().unwrap();
        assert!(backend.starts_with("Drawn by the processor") && backend.contains("WebGPU"), "{backend}");
        let pictures = pictures(&told, &asset, FrameQuality::PREVIEW);
        let mut last = &Vec::new();
        for (at, (found, wanted)) in pictures.iter().enumerate() {
            assert_eq!(found.len(), wanted.len());
            let off = found.iter().zip(wanted).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(off <= Some(DIFFERENCE), "picture {at} is {off:?} off");
            assert!(found != last, "picture {at} is the one before");
            last = found;
        }
        assert_eq!(pictures.len(), 3);
    }
}

#[test]
fn a_browser_with_webgpu_draws_the_processors_pictures_on_its_card() {
    /// Root mean square of the difference, of 255, and the share of values within two levels, as of all whole pictures of a card.
    const OFF: f64 = 0.5;
    const WITHIN_TWO: f64 = 0.999;
    let (Some(module), Some(browser)) = (module("squall-page", "page"), browser()) else { return };
    let asset = root().join("data/golden/v1/golden.squall");
    let folder = folder(&module, &asset);
    let told = played(browser, (folder.path(), ""), 1200, (&WITH_CARD, TEST_SCRIPT));
    check(&told);
    let backend = told["backend"].as_str().unwrap();
    assert!(backend.starts_with("Drawn on the graphics card: "), "{backend}");
    // The card looks at sky and cloud at every pixel. A preview of the processor's lets them lie between nodes where light is even
    // within a tenth: ten levels of the afterglow's red in the water.
    let mut every_pixel = FrameQuality::PREVIEW;
    every_pixel.sky.pixels = 1;
    let pictures = pictures(&told, &asset, every_pixel);
    assert_eq!(pictures.len(), 3);
    for (at, (found, wanted)) in pictures.iter().enumerate() {
        assert_eq!(found.len(), wanted.len());
        let off: Vec<u8> = found.iter().zip(wanted).map(|(a, b)| a.abs_diff(*b)).collect();
        let colours = off.len() as f64 * 0.75;
        let square: f64 = off.iter().map(|&off| f64::from(off) * f64::from(off)).sum();
        let far = off.iter().filter(|&&off| off > 2).count() as f64;
        let (off, within) = ((square / colours).sqrt(), 1.0 - far / colours);
        println!("picture {at}: {off} of 255, {within} within two");
        assert!(off < OFF && within >= WITHIN_TWO, "picture {at}: {off} of 255, {within} within two");
        assert!(at == 0 || *found != pictures[at - 1].0, "picture {at} is the one before");
    }
    // README.md's picture: docs/page.md.
    if let Some(asset) = std::env::var_os("SQUALL_SCREENSHOT_ASSET") {
        std::fs::copy(asset, folder.path().join("asset.squall")).unwrap();
        let told = played(browser, (folder.path(), "?width=640"), 1200, (&WITH_CARD, SHOWN));
        assert_eq!(told["errors"], Value::Array(Vec::new()), "{told}");
    }
}

/// What is done on the page before a picture of it is taken.
const SHOWN: &str = r#"
const told = { errors: window.errors };
try {
  await squall.ready;
  await squall.set({ fov_deg: 50, gain: 4 });
  await squall.strike(0.6, 0.3);
} catch (error) {
  told.errors.push(String(error));
}
await fetch("/told", { method: "POST", body: JSON.stringify(told) });
"#;

#[cfg(feature = "gpu")]
#[test]
fn every_shader_compiles_in_a_browser_without_a_word() {
    const SCRIPT: &str = r#"
const told = { errors: window.errors, shaders: 0 };
try {
  const adapter = await navigator.gpu.requestAdapter();
  const device = await adapter.requestDevice();
  for (const { name, code } of SHADERS) {
    const module = device.createShaderModule({ code });
    const { messages } = await module.getCompilationInfo();
    for (const { lineNum, message } of messages) told.errors.push(`${name}, line ${lineNum}: ${message}`);
    told.shaders += 1;
  }
} catch (error) {
  told.errors.push(String(error));
}
await fetch("/told", { method: "POST", body: JSON.stringify(told) });
"#;
    let Some(browser) = browser() else { return };
    let shaders: Vec<Value> = squall_runtime::gpu::shaders()
        .map(|(name, code)| serde_json::json!({ "name": name, "code": code }))
        .collect();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("index.html"), "<!doctype html><main></main></html>").unwrap();
    let script = format!("const SHADERS = {};{SCRIPT}", Value::from(shaders.clone()));
    let told = played(browser, (folder.path(), ""), 600, (&WITH_CARD, &script));
    assert_eq!(
        (&told["errors"], &told["shaders"]),
        (&Value::from(Vec::<Value>::new()), &shaders.len().into())
    );
}

#[test]
fn an_asset_without_a_view_is_looked_at_from_beside_its_cloud_and_struck() {
    let asset = root().join("data/golden/v3/sun.squall");
    let mut player = Player::default();
    player.open_whole(&std::fs::read(asset).unwrap()).unwrap();
    let dark = player.draw(32, 18).unwrap().to_vec();
    let moved = player.strike(0.5, 0.5).unwrap();
    assert!(moved.is_finite());
    assert!(player.draw(32, 18).unwrap() != dark);
    player.set("flash", 0.0).unwrap();
    assert!(player.draw(32, 18).unwrap() == dark);
    let refused = player.set("rain_mm", 1.0).unwrap_err().to_string();
    assert!(refused.starts_with("control: wanted rate_mm_per_h, "), "{refused}");
    assert!(player.draw(0, 18).unwrap_err().to_string().contains("width"));
}
