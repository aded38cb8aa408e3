//! What all fuzz targets share: memory beyond 256 MB is refused at the very allocation, which ends the run with its stack.

/// The largest sum of live allocations [bytes].
const MOST: usize = 256 << 20;

#[global_allocator]
static MEMORY: cap::Cap<std::alloc::System> = cap::Cap::new(std::alloc::System, MOST);

/// A panic inside a guarded decoder is answered with an error and is no finding; any other is.
pub fn let_guarded_panics_pass() {
    let report = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if !twopass::film::guard::in_guarded_decoder() {
            report(info);
        }
    }));
}
