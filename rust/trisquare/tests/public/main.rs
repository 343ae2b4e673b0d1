//! The crate as its users call it. One program, which compiles what is generic over the lens once.

mod any_lens;
mod boards;
mod calibrate;
mod chessboard;
mod edge_scene;
mod equidistant;
mod fisheye;
mod localise;
mod picture;
mod properties;
mod rational;
mod stored;
mod tone;
mod trust;
mod undistort;
