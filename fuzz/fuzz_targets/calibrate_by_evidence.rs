#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    trisquare_fuzz::calibrate_by_evidence(data);
});
