//! Chessboards: how their crossings are linked, the lattice that grows from one, and their lines.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use nalgebra::{Matrix3, Vector2};
use trisquare::internals::{Crossing, Follower, GreyBytes, Lattice};
use trisquare::synthetic::Scene;
use trisquare::{EdgeSpan, ImageSize, Lens, Pose};

use crate::Outcome;
use crate::bytes::Bytes;
use crate::figures::{View, scenes};
use crate::pixels::{Canvas, measured_spans};

/// Small, as a board of a few cells is enough.
const SIZE: ImageSize = ImageSize {
    width: 96,
    height: 72,
};

/// Cells along a board's side: with fewer none has four neighbours, with more none holds an edge.
const CELLS: [usize; 4] = [3, 4, 5, 6];

/// How far a step across an edge reaches, in cells.
const SOFTNESS: f64 = 0.15;

static SCENES: LazyLock<Vec<Scene>> = LazyLock::new(|| scenes(SIZE));

/// A board in place of a view's first square.
struct Board {
    view: View,
    cells: usize,
}

impl Board {
    fn drawn(bytes: &mut Bytes<'_>) -> Self {
        let mut view = View::sound(bytes, &SCENES);
        // Nearer, so that its cells hold an edge; the other squares would hide it.
        view.poses.truncate(1);
        view.poses[0].translation *= bytes.between(0.3, 1.2);
        let cells = bytes.pick(&CELLS);
        Self { view, cells }
    }

    /// Place on the plane of an inner crossing.
    fn place(&self, row: usize, column: usize) -> Vector2<f64> {
        Vector2::new(column as f64, row as f64) / self.cells as f64 - Vector2::repeat(0.5)
    }

    fn crossing(&self, row: usize, column: usize) -> Crossing {
        let place = self.place(row, column);
        let seen = |step: Vector2<f64>| self.view.see(0, place + step / self.cells as f64);
        let point = seen(Vector2::zeros());
        let along = [Vector2::x(), Vector2::y()].map(|step| (seen(step) - point).normalize());
        // Below and to the right of a crossing of an even sum it is dark: clockwise of the row.
        let edges = match (row + column).is_multiple_of(2) {
            true => along,
            false => [along[1], -along[0]],
        };
        Crossing { point, edges }
    }

    fn crossings(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let inner = self.cells;
        (1..inner).flat_map(move |row| (1..inner).map(move |column| (row, column)))
    }

    /// Light to dark, with steps as soft as a cell is small; grey beyond.
    fn canvas(&self, bytes: &mut Bytes<'_>) -> Canvas {
        let (dark, light) = (bytes.between(0.0, 0.4), bytes.between(0.4, 1.0));
        let noise = bytes.power(-4.0, -1.0);
        let mut state = bytes.seed();
        let cells = self.cells as f64;
        Canvas::drawn(SIZE, |pixel| {
            let place = on_plane(&self.view, &self.view.poses[0], pixel);
            let inside = place.filter(|p| p.amax() < 0.5);
            let wave =
                |t: f64| ((std::f64::consts::PI * (t + 0.5) * cells).sin() / SOFTNESS / 2.0).tanh();
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            let disturbance = (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5;
            let shade = inside.map_or(0.0, |p| -wave(p.x) * wave(p.y));
            (light + dark) / 2.0 + (light - dark) / 2.0 * shade + noise * disturbance
        })
    }

    /// Its inner grid lines with their crossings: all rows, then all columns.
    fn lines(&self) -> Vec<EdgeSpan> {
        let inner = self.cells - 1;
        (0..2 * inner)
            .map(|line| {
                let is_row = line < inner;
                let own = 1 + line % inner;
                let site = |k: usize| if is_row { (own, k) } else { (k, own) };
                let crosses = |k: usize| if is_row { inner + k - 1 } else { k - 1 };
                let path = (1..=inner).map(|k| self.crossing(site(k).0, site(k).1).point);
                EdgeSpan {
                    path: path.collect(),
                    polarity: if own.is_multiple_of(2) == is_row {
                        1.0
                    } else {
                        -1.0
                    },
                    bounds: [None, None],
                    crossings: (1..=inner).map(|k| (Some(crosses(k)), k)).collect(),
                    ..EdgeSpan::new(Vec::new(), 1.0)
                }
            })
            .collect()
    }
}

/// The point of a plane that a pixel shows.
fn on_plane(view: &View, pose: &Pose, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
    let ray = view.camera.unproject(&pixel)?;
    let columns = [
        pose.rotation.column(0).into(),
        pose.rotation.column(1).into(),
        -ray,
    ];
    let found = Matrix3::from_columns(&columns).try_inverse()? * -pose.translation;
    Some(found.xy())
}

/// `trisquare::internals::link_crossings` on a board or on anything.
pub fn link_crossings(data: &[u8]) -> Outcome {
    let bytes = &mut Bytes::new(data);
    let (crossings, _, canvas) = crossings_and_picture(bytes);
    let (width, height, values) = canvas.grey_bytes();
    let picture = GreyBytes::new(width, height, &values).expect("the values fill the size");
    let links = trisquare::internals::link_crossings(&picture, &crossings);
    assert_eq!(links.len(), crossings.len());
    for (number, followers) in links.iter().enumerate() {
        for (direction, follower) in followers.iter().enumerate() {
            let Some(Follower { crossing, back }) = *follower else {
                continue;
            };
            let home = Follower {
                crossing: number,
                back: direction,
            };
            assert!(crossing != number && (direction + back) % 2 == 1);
            assert_eq!(links[crossing][back], Some(home), "a link leads back");
        }
    }
    match links.iter().flatten().flatten().count() {
        0 => "no link",
        _ => "Ok",
    }
}

/// `trisquare::internals::Lattice::grow` from some cells of a board, or from anything.
pub fn grow_lattice(data: &[u8]) -> Outcome {
    let bytes = &mut Bytes::new(data);
    let (crossings, sites, canvas) = crossings_and_picture(bytes);
    let (width, height, values) = canvas.grey_bytes();
    let picture = GreyBytes::new(width, height, &values).expect("the values fill the size");
    // Any integers; those of a corner of the picture's coordinates at times.
    let origin = match bytes.below(8) {
        0 => (i32::MAX - bytes.below(4) as i32, i32::MIN),
        1 => (bytes.seed() as i32, bytes.seed() as i32),
        _ => (0, 0),
    };
    let known = 2 + bytes.below(2) as i32;
    let start = sites
        .iter()
        .zip(&crossings)
        .filter(|((row, column), _)| *row <= known && *column <= known)
        .map(|((row, column), crossing)| {
            let site = (origin.0.wrapping_add(*row), origin.1.wrapping_add(*column));
            (site, crossing.point)
        });
    let before: BTreeMap<_, _> = start.collect();
    let mut lattice = Lattice {
        crossings: before.clone(),
        dark_first: bytes.once_in(2),
    };
    lattice.grow(&picture, &crossings);
    assert!(lattice.crossings.len() <= before.len() + crossings.len());
    let added = lattice
        .crossings
        .iter()
        .filter(|(site, _)| !before.contains_key(site));
    for (_, point) in added {
        assert!(point.iter().all(|v| v.is_finite()), "{point}");
    }
    match lattice.crossings.len() - before.len() {
        0 => "nothing to add",
        _ => "Ok",
    }
}

/// A board's crossings and picture, damaged at times, or garbage.
fn crossings_and_picture(bytes: &mut Bytes<'_>) -> (Vec<Crossing>, Vec<(i32, i32)>, Canvas) {
    let board = Board::drawn(bytes);
    let mut canvas = match bytes.once_in(8) {
        true => Canvas::garbage(bytes),
        false => board.canvas(bytes),
    };
    if bytes.once_in(3) {
        canvas.damage(bytes);
    }
    let sites = board.crossings().map(|(r, c)| (r as i32, c as i32));
    let mut sites: Vec<_> = sites.collect();
    let seen = board.crossings().map(|(r, c)| board.crossing(r, c));
    let mut crossings: Vec<_> = seen.collect();
    for _ in 0..bytes.below(4) {
        let any = |bytes: &mut Bytes<'_>| Vector2::new(bytes.coefficient(), bytes.coefficient());
        let wrong = Crossing {
            point: bytes.point(SIZE),
            edges: [any(bytes), any(bytes)],
        };
        let at = bytes.below(crossings.len());
        match bytes.below(4) {
            0 => crossings[at] = wrong,
            1 => crossings.push(crossings[at]),
            2 => crossings.push(wrong),
            _ => crossings[at].edges.swap(0, 1),
        }
        sites.resize(crossings.len(), (at as i32, at as i32));
    }
    (crossings, sites, canvas)
}

/// `trisquare::localise` along the lines of a board, which cross.
pub fn localise_grid_lines(data: &[u8]) -> Outcome {
    let bytes = &mut Bytes::new(data);
    let board = Board::drawn(bytes);
    let mut canvas = match bytes.once_in(16) {
        true => Canvas::garbage(bytes),
        false => board.canvas(bytes),
    };
    if bytes.once_in(3) {
        canvas.damage(bytes);
    }
    let mut lines = board.lines();
    if bytes.once_in(2) {
        for _ in 0..bytes.below(5) {
            damage_line(&mut lines, bytes);
        }
    }
    let picture = canvas.picture(bytes);
    if bytes.once_in(2) {
        let (found, estimate) = trisquare::localise_with_unknown_tone(&picture, &lines);
        assert!(estimate.picture_tone().is_valid(), "{estimate:?}");
        return measured_spans(&found);
    }
    let found = trisquare::localise(&picture, &lines, bytes.tone());
    assert_eq!(found.len(), lines.len());
    measured_spans(&found)
}

fn damage_line(lines: &mut [EdgeSpan], bytes: &mut Bytes<'_>) {
    let line = bytes.below(lines.len());
    let any = (bytes.once_in(2)).then(|| bytes.below(2 * lines.len()));
    let span = &mut lines[line];
    let at = bytes.below(span.path.len().max(1));
    match bytes.below(10) {
        0 => span.path = bytes.points(SIZE, 6),
        1 => span.polarity = bytes.coefficient(),
        2 => span.bounds = [any, Some(line)],
        3 => span.crossings.truncate(at),
        4 => span.crossings.reverse(),
        5 => span.path.reverse(),
        6 if at < span.path.len() => {
            span.path[at] += Vector2::new(bytes.coefficient(), bytes.coefficient());
        }
        7 => span.rims = vec![bytes.coefficient(); at],
        8 if at < span.crossings.len() => {
            span.crossings[at] = (any, bytes.seed() as usize);
        }
        // A crossing that is hidden.
        _ if at < span.path.len().min(span.crossings.len()) => {
            span.path.remove(at);
            span.crossings.remove(at);
        }
        _ => {}
    }
}
