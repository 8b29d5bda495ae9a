//! Compute pipelines are compiled beside each other, on as many threads as the machine has cores, while the asset is brought to the
//! card; whoever needs one first waits for it. A web page has no threads, and a software adapter compiles on the very cores that would
//! wait (lavapipe of Mesa 22.3 does not survive two compilers at once): there each is compiled when it is made.

use super::Gpu;
use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::JoinHandle;

/// What makes a pipeline.
type Make = dyn Fn() -> wgpu::ComputePipeline + Send + Sync;

/// Pipelines that wait to be compiled, and threads that do it. Whoever lets go of it last waits for what is being compiled: no thread is
/// left in a driver when the program ends.
pub struct Compiler {
    /// Threads at most; with none, pipelines are compiled when they are made.
    most: usize,
    queue: Arc<Mutex<Queue>>,
    crew: Mutex<Vec<JoinHandle<()>>>,
}

impl Drop for Compiler {
    fn drop(&mut self) {
        lock(&self.queue).waiting.clear();
        let crew = self.crew.get_mut().unwrap_or_else(PoisonError::into_inner);
        // One that panicked has said so.
        crew.drain(..).for_each(|thread| drop(thread.join()));
    }
}

#[derive(Default)]
struct Queue {
    waiting: VecDeque<(Arc<Make>, Sender<wgpu::ComputePipeline>)>,
    threads: usize,
}

fn lock(queue: &Mutex<Queue>) -> MutexGuard<'_, Queue> {
    queue.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A pipeline that is being compiled, or has been.
pub struct Compiled {
    pipeline: OnceLock<wgpu::ComputePipeline>,
    coming: Mutex<Option<Receiver<wgpu::ComputePipeline>>>,
    make: Arc<Make>,
}

impl Compiled {
    /// The pipeline, waited for.
    pub fn get(&self) -> &wgpu::ComputePipeline {
        self.pipeline.get_or_init(|| {
            let coming = self.coming.lock().unwrap_or_else(PoisonError::into_inner).take();
            // A thread that did not manage says why when it is tried again here.
            coming.and_then(|coming| coming.recv().ok()).unwrap_or_else(|| (self.make)())
        })
    }
}

impl Compiler {
    /// Threads for the pipelines of a device.
    pub fn new(device: &wgpu::Device) -> Self {
        let is_software = device.adapter_info().device_type == wgpu::DeviceType::Cpu;
        let has_threads = !cfg!(target_family = "wasm") && !is_software;
        let cores = || std::thread::available_parallelism().map_or(1, |count| count.get());
        Self { most: if has_threads { cores() } else { 0 }, queue: Arc::default(), crew: Mutex::default() }
    }

    /// Begins to compile.
    fn begin(&self, make: Arc<Make>) -> Option<Receiver<wgpu::ComputePipeline>> {
        if self.most == 0 {
            return None;
        }
        let (send, coming) = channel();
        let mut queue = lock(&self.queue);
        queue.waiting.push_back((make, send));
        if queue.threads < self.most {
            let own = self.queue.clone();
            let thread = std::thread::Builder::new().name("squall pipelines".to_owned());
            match thread.spawn(move || compile(&own)) {
                Ok(thread) => {
                    queue.threads += 1;
                    self.crew.lock().unwrap_or_else(PoisonError::into_inner).push(thread);
                }
                // Without a thread whoever waits compiles for itself.
                Err(_) if queue.threads == 0 => queue.waiting.clear(),
                Err(_) => {}
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
        let compiled = Compiled { pipeline: OnceLock::new(), coming, make };
        if self.compiler.most == 0 {
            compiled.get();
        }
        compiled
    }
}
