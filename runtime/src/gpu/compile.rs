//! Compute pipelines are compiled beside each other, on as many threads as the machine has cores, while the asset is brought to the
//! card; whoever needs one first waits for it. A web page has no threads, and a software adapter compiles on the very cores that would
//! wait (lavapipe of Mesa 22.3 does not survive two compilers at once): there each is compiled when it is made.

use super::Gpu;
use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::JoinHandle;

/// What makes a pipeline.
type Make<T> = dyn Fn() -> T + Send + Sync;

/// Pipelines that wait to be compiled, and threads that do it. Whoever lets go of it last waits for what is being compiled: no thread is
/// left in a driver when the program ends.
pub struct Compiler<T: Send + 'static = wgpu::ComputePipeline> {
    /// Threads at most; with none, pipelines are compiled when they are made.
    most: usize,
    queue: Arc<Mutex<Queue<T>>>,
    crew: Mutex<Vec<JoinHandle<()>>>,
}

struct Queue<T> {
    waiting: VecDeque<(Arc<Make<T>>, Sender<T>)>,
    threads: usize,
}

fn lock<T>(held: &Mutex<T>) -> MutexGuard<'_, T> {
    held.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A pipeline that is being compiled, or has been.
pub struct Compiled<T: 'static = wgpu::ComputePipeline> {
    pipeline: OnceLock<T>,
    coming: Mutex<Option<Receiver<T>>>,
    make: Arc<Make<T>>,
}

impl<T> Compiled<T> {
    /// The pipeline, waited for.
    pub fn get(&self) -> &T {
        self.pipeline.get_or_init(|| {
            let coming = lock(&self.coming).take();
            // A thread that did not manage says why when it is tried again here.
            coming.and_then(|coming| coming.recv().ok()).unwrap_or_else(|| (self.make)())
        })
    }
}

impl<T: Send + 'static> Drop for Compiler<T> {
    fn drop(&mut self) {
        lock(&self.queue).waiting.clear();
        let crew = self.crew.get_mut().unwrap_or_else(PoisonError::into_inner);
        // One that panicked has said so.
        crew.drain(..).for_each(|thread| drop(thread.join()));
    }
}

impl<T: Send + 'static> Compiler<T> {
    fn with_threads(most: usize) -> Self {
        let queue = Queue { waiting: VecDeque::new(), threads: 0 };
        Self { most, queue: Arc::new(Mutex::new(queue)), crew: Mutex::default() }
    }

    /// Begins to make something.
    fn begin(&self, make: Arc<Make<T>>) -> Compiled<T> {
        let compiled =
            |coming| Compiled { pipeline: OnceLock::new(), coming: Mutex::new(coming), make: make.clone() };
        if self.most == 0 {
            let own = compiled(None);
            own.get();
            return own;
        }
        let (send, coming) = channel();
        let mut queue = lock(&self.queue);
        queue.waiting.push_back((make.clone(), send));
        if queue.threads < self.most {
            let own = self.queue.clone();
            let thread = std::thread::Builder::new().name("squall pipelines".to_owned());
            match thread.spawn(move || compile(&own)) {
                Ok(thread) => {
                    queue.threads += 1;
                    lock(&self.crew).push(thread);
                }
                // Without a thread whoever waits compiles for itself.
                Err(_) if queue.threads == 0 => queue.waiting.clear(),
                Err(_) => {}
            }
        }
        compiled(Some(coming))
    }
}

/// Compiles what waits until nothing does.
fn compile<T>(queue: &Mutex<Queue<T>>) {
    /// Counts a thread that ends, however it does.
    struct Ends<'a, T>(&'a Mutex<Queue<T>>);
    impl<T> Drop for Ends<'_, T> {
        fn drop(&mut self) {
            let mut queue = lock(self.0);
            queue.threads -= 1;
            if queue.threads == 0 {
                // Nobody is left for what still waits: whoever asks for it makes it.
                queue.waiting.clear();
            }
        }
    }
    let ends = Ends(queue);
    loop {
        let mut own = lock(queue);
        let Some((make, send)) = own.waiting.pop_front() else {
            // In one step with having found nothing, so that nothing is put behind a thread that goes.
            own.threads -= 1;
            std::mem::forget(ends);
            return;
        };
        drop(own);
        // Nobody may wait any more.
        let _ = send.send(make());
    }
}

impl Compiler {
    /// Threads for the pipelines of a device.
    pub fn new(device: &wgpu::Device) -> Self {
        let is_software = device.adapter_info().device_type == wgpu::DeviceType::Cpu;
        let has_threads = !cfg!(target_family = "wasm") && !is_software;
        let cores = || std::thread::available_parallelism().map_or(1, |count| count.get());
        Self::with_threads(if has_threads { cores() } else { 0 })
    }
}

impl Gpu {
    /// A pipeline of `make`, which is compiled while others are.
    pub(crate) fn compiled(&self, make: Arc<Make<wgpu::ComputePipeline>>) -> Compiled {
        self.compiler.begin(make)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn everything_is_made_once_on_any_number_of_threads_and_waited_for() {
        for threads in [0, 1, 4] {
            let compiler = Compiler::with_threads(threads);
            let made = Arc::new(AtomicUsize::new(0));
            let things: Vec<Compiled<usize>> = (0..40)
                .map(|number| {
                    let made = made.clone();
                    compiler.begin(Arc::new(move || {
                        made.fetch_add(1, Ordering::Relaxed);
                        std::thread::yield_now();
                        3 * number
                    }))
                })
                .collect();
            for (number, thing) in things.iter().enumerate().rev() {
                assert_eq!((*thing.get(), *thing.get()), (3 * number, 3 * number));
            }
            assert_eq!(made.load(Ordering::Relaxed), 40, "{threads} threads");
        }
    }

    #[test]
    fn what_a_thread_does_not_manage_is_tried_by_whoever_needs_it() {
        let compiler = Compiler::with_threads(2);
        let make = || match std::thread::current().name() {
            Some("squall pipelines") => panic!("a driver that gives up, on purpose"),
            _ => 7,
        };
        let things: Vec<Compiled<i32>> = (0..5).map(|_| compiler.begin(Arc::new(make))).collect();
        assert!(things.iter().all(|thing| *thing.get() == 7));
    }

    #[test]
    fn a_compiler_that_is_let_go_of_leaves_no_thread() {
        let running = Arc::new(AtomicUsize::new(0));
        let compiler = Compiler::with_threads(2);
        let things: Vec<Compiled<()>> = (0..20)
            .map(|_| {
                let running = running.clone();
                compiler.begin(Arc::new(move || {
                    running.fetch_add(1, Ordering::SeqCst);
                    std::thread::yield_now();
                    running.fetch_sub(1, Ordering::SeqCst);
                }))
            })
            .collect();
        drop(compiler);
        assert_eq!(running.load(Ordering::SeqCst), 0);
        // What nobody came to is still made.
        things.iter().for_each(|thing| *thing.get());
    }
}
