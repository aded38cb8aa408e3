//! Work that is compiled twice: for any processor, and for those with AVX2. The operations and their order are the same, without fused
//! multiply-add, and so are the results, bit for bit.

#![allow(unsafe_code, reason = "a call into a function compiled for AVX2 after asking for it")]

/// Work whose code is to be inlined into the place where the vector instructions are known: [`Self::run`] is to be `#[inline(always)]`.
pub trait Work {
    /// What it gives.
    type Output;

    /// Does it.
    fn run(self) -> Self::Output;
}

/// Does the work by the widest vector instructions that it is compiled for and the processor has.
#[inline]
pub fn widest<W: Work>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1") && is_x86_feature_detected!("bmi2") {
        // SAFETY: the processor has what the function is compiled for.
        return unsafe { by_avx2(work) };
    }
    work.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2")]
fn by_avx2<W: Work>(work: W) -> W::Output {
    work.run()
}
