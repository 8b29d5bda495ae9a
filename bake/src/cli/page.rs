//! `squall page ASSET -o DIR`

mod module;

use super::common::Common;
use super::folder::{OutputFolder, check_apart};
use super::json;
use serde_json::json;
use squall_bake::BakeError;
use squall_bake::output::write_atomically;
use squall_bake::provenance::tool;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Makes a web page that plays an asset: a folder of files for any static server.
///
/// The page draws with WebGPU, or on its visitor's processor where a browser has none, and strikes where somebody clicks.
#[derive(clap::Args)]
pub struct Args {
    /// The asset.
    asset: PathBuf,
    /// The folder: index.html, scripts, the module and the asset go there.
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// The page's module. If left out, squall_page.wasm beside this command, or where cargo puts it in a clone:
    /// `cargo build --profile page -p squall-page --target wasm32-unknown-unknown`.
    #[arg(long, value_name = "FILE")]
    module: Option<PathBuf>,
    /// Print one JSON object instead of words: docs/json.md.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: Common,
}

impl Args {
    /// Whether the answer is to be JSON.
    pub fn json(&self) -> bool {
        self.json
    }
}

/// The page's own files. They belong to crate `squall-page`, whose module they call.
const FILES: [(&str, &str); 5] = [
    ("index.html", include_str!("../../../runtime/page/web/index.html")),
    ("page.css", include_str!("../../../runtime/page/web/page.css")),
    ("page.js", include_str!("../../../runtime/page/web/page.js")),
    ("gpu.js", include_str!("../../../runtime/page/web/gpu.js")),
    ("worker.js", include_str!("../../../runtime/page/web/worker.js")),
];
const MODULE: &str = "squall_page.wasm";
/// The asset's name in the folder: page.js asks for it.
const ASSET: &str = "asset.squall";

/// Checks the asset, then writes the folder.
pub fn run(args: Args) -> anyhow::Result<()> {
    let bars = args.common.start()?;
    let asset = super::asset::open(&args.asset)?;
    let path = module_file(args.module.as_deref())?;
    let module = std::fs::read(&path).map_err(BakeError::io(&path, "read"))?;
    if let Some(found) = module::fault(&module) {
        return Err(BakeError::input(&path, "module", "a whole WebAssembly module", found).into());
    }
    let names: Vec<&str> = FILES.iter().map(|(name, _)| *name).chain([MODULE, ASSET]).collect();
    let outputs: Vec<PathBuf> = names.iter().map(|name| args.out.join(name)).collect();
    let outputs: Vec<&Path> = outputs.iter().map(PathBuf::as_path).collect();
    check_apart(&outputs, [args.asset.clone(), path].iter())?;
    let mut folder = OutputFolder::prepare(&args.out)?;
    folder.expect(names.iter().copied())?;
    folder.write(|folder| {
        let texts = FILES.iter().map(|(name, text)| (*name, text.as_bytes()));
        for (name, bytes) in texts.chain([(MODULE, module.as_slice()), (ASSET, asset.bytes())]) {
            write_atomically(&folder.join(name), |out| out.write_all(bytes))?;
        }
        Ok(())
    })?;
    let page = module.len() + FILES.iter().map(|(_, text)| text.len()).sum::<usize>();
    if args.json {
        return json::answer(&json!({
            "command": "page", "tool": tool(), "folder": args.out.to_string_lossy(),
            "page_bytes": page, "asset_bytes": asset.bytes().len(),
        }));
    }
    bars.say(&format!(
        "{}: {page} bytes of page and module, {} bytes of asset; any static server shows it, such as\n\
         python3 -m http.server --directory {}",
        args.out.join("index.html").display(),
        asset.bytes().len(),
        args.out.display()
    ));
    Ok(())
}

/// The page's module: the one named, or where builds put it.
fn module_file(named: Option<&Path>) -> Result<PathBuf, BakeError> {
    if let Some(path) = named {
        return Ok(path.to_owned());
    }
    let beside = std::env::current_exe().ok().and_then(|command| Some(command.parent()?.to_owned()));
    let folders = beside.iter().flat_map(|folder| {
        let built = folder.join("../wasm32-unknown-unknown/page");
        [folder.clone(), built]
    });
    let found = folders.map(|folder| folder.join(MODULE)).find(|path| path.is_file());
    found.ok_or_else(|| {
        let wanted = "the page's module beside this command, or --module FILE \
                      (cargo build --profile page -p squall-page --target wasm32-unknown-unknown makes it)";
        BakeError::input(Path::new(MODULE), "module", wanted, "none")
    })
}
