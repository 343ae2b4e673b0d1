//! Tests of the crate's public interface. They are one program, so that code generic over the lens
//! is compiled once.

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
