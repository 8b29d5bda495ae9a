//! Compute pipelines are compiled beside each other, on as many threads as the machine has cores, while the asset is brought to the
//! card; whoever needs one first waits for it. A web page has no threads: there they are compiled at once.

use super::Gpu;
use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// What makes a pipeline.
type Make = dyn Fn() -> wgpu::ComputePipeline + Send + Sync;

/// Pipelines that wait to be compiled, and threads that do it.
#[derive(Clone, Default)]
pub struct Compiler(Arc<Mutex<Queue>>);

#[derive(Default)]
struct Queue {
    waiting: VecDeque<(Arc<Make>, Sender<wgpu::ComputePipeline>)>,
    threads: usize,
}

fn lock(queue: &Mutex<Queue>) -> MutexGuard<'_, Queue> {
    queue.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A pipeline that is being compiled, or has been. Clones are the same one.
#[derive(Clone)]
pub struct Compiled(Arc<State>);

struct State {
    pipeline: OnceLock<wgpu::ComputePipeline>,
    coming: Mutex<Option<Receiver<wgpu::ComputePipeline>>>,
    make: Arc<Make>,
}

impl Compiled {
    /// The pipeline, waited for.
    pub fn get(&self) -> &wgpu::ComputePipeline {
        self.0.pipeline.get_or_init(|| {
            let coming = self.0.coming.lock().unwrap_or_else(PoisonError::into_inner).take();
            // A thread that did not manage says why when it is tried again here.
            coming.and_then(|coming| coming.recv().ok()).unwrap_or_else(|| (self.0.make)())
        })
    }
}

impl Compiler {
    /// Begins to compile.
    fn begin(&self, make: Arc<Make>) -> Option<Receiver<wgpu::ComputePipeline>> {
        if cfg!(target_family = "wasm") {
            return None;
        }
        let (send, coming) = channel();
        let mut queue = lock(&self.0);
        queue.waiting.push_back((make, send));
        let most = std::thread::available_parallelism().map_or(1, |count| count.get());
        if queue.threads < most {
            let own = self.0.clone();
            // Without a thread whoever waits compiles for itself.
            let work = std::thread::Builder::new().name("squall pipelines".to_owned());
            queue.threads += usize::from(work.spawn(move || compile(&own)).is_ok());
            if queue.threads == 0 {
                queue.waiting.clear();
            }
        }
        Some(coming)
    }
}

/// Compiles what waits until nothing does.
fn compile(queue: &Mutex<Queue>) {
    loop {
        let next = {
            let mut queue = lock(queue);
            let next = queue.waiting.pop_front();
            queue.threads -= usize::from(next.is_none());
            next
        };
        let Some((make, send)) = next else { return };
        // Nobody may wait any more.
        let _ = send.send(make());
    }
}

impl Gpu {
    /// A pipeline of `make`, which is compiled while others are.
    pub(crate) fn compiled(&self, make: Arc<Make>) -> Compiled {
        let coming = Mutex::new(self.compiler.begin(make.clone()));
        let compiled = Compiled(Arc::new(State { pipeline: OnceLock::new(), coming, make }));
        if cfg!(target_family = "wasm") {
            compiled.get();
        }
        compiled
    }
}
