#![no_main]

libfuzzer_sys::fuzz_target!(init: twopass_fuzz::let_guarded_panics_pass(), |bytes: &[u8]| {
    twopass::load::fuzz::serialized(bytes);
});
