//! Large pages for large arrays: fewer page faults while a tree is built, fewer misses of the address cache while it is traversed.

#![allow(unsafe_code, reason = "a call to the system about memory that a vector owns")]

/// Size of a large page in bytes, on x86-64 and usually elsewhere.
#[cfg(any(target_os = "linux", test))]
const LARGE: usize = 2 << 20;

/// A vector with room for `capacity` items, in large pages where the system grants them.
pub fn in_large_pages<T>(capacity: usize) -> Vec<T> {
    let items = Vec::with_capacity(capacity);
    #[cfg(all(target_os = "linux", not(miri)))]
    advise(&items);
    items
}

#[cfg(all(target_os = "linux", not(miri)))]
fn advise<T>(items: &Vec<T>) {
    use nix::sys::mman::{MmapAdvise, madvise};
    let start = items.as_ptr() as usize;
    let (first, end) = (start.next_multiple_of(LARGE), (start + items.capacity() * size_of::<T>()) / LARGE * LARGE);
    if first >= end {
        return;
    }
    let Some(address) = std::ptr::NonNull::new(items.as_ptr().wrapping_byte_add(first - start).cast_mut().cast()) else { return };
    // SAFETY: the range lies inside memory that `items` owns, and this advice changes neither its contents nor its validity.
    let advised = unsafe { madvise(address, end - first, MmapAdvise::MADV_HUGEPAGE) };
    // Advice only: a system that does not take it serves small pages.
    advised.ok();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_vector_has_its_capacity_and_holds_what_is_put_into_it() {
        let sizes: &[usize] = if cfg!(miri) { &[0, 1, 100] } else { &[0, 1, LARGE / 8 - 1, 3 * LARGE / 8 + 5] };
        for &n in sizes {
            let mut items = in_large_pages::<u64>(n);
            assert!(items.capacity() >= n);
            items.extend(0..n as u64);
            assert!(items.iter().enumerate().all(|(i, &item)| i as u64 == item));
        }
    }
}
