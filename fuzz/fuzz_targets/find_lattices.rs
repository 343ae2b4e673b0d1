#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    trisquare_fuzz::find_lattices(data);
});
