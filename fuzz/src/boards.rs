//! Chessboards: finding lattices, and measuring the lines of a board.

use std::sync::LazyLock;

use nalgebra::{Matrix3, Vector2};
use trisquare::internals::GreyBytes;
use trisquare::synthetic::Scene;
use trisquare::{Chessboard, EdgeSpan, ImageSize, Lens, Picture, Pose};

use crate::Outcome;
use crate::bytes::Bytes;
use crate::figures::{View, scenes};
use crate::pixels::{Canvas, measured_spans};

/// Small, because a board of a few cells is enough.
const SIZE: ImageSize = ImageSize {
    width: 96,
    height: 72,
};

/// Numbers of cells along a board's side. With fewer, no cell has four neighbours; with more, no
/// cell is large enough to measure an edge.
const CELLS: [usize; 4] = [3, 4, 5, 6];

/// Width of the step across an edge, in cells.
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
        // Nearer, so that its cells are large enough to measure; the other squares would hide it.
        view.poses.truncate(1);
        view.poses[0].translation *= bytes.between(0.3, 1.2);
        let cells = bytes.pick(&CELLS);
        Self { view, cells }
    }

    /// Returns the position on the plane of an inner crossing.
    fn place(&self, row: usize, column: usize) -> Vector2<f64> {
        Vector2::new(column as f64, row as f64) / self.cells as f64 - Vector2::repeat(0.5)
    }

    fn crossing(&self, row: usize, column: usize) -> Vector2<f64> {
        self.view.see(0, self.place(row, column))
    }

    /// Draws the board's dark and light cells, with steps of a width proportional to the cell; grey
    /// outside the board.
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

    /// Returns the board's inner grid lines with their crossings: all rows, then all columns.
    fn lines(&self) -> Vec<EdgeSpan> {
        let inner = self.cells - 1;
        (0..2 * inner)
            .map(|line| {
                let is_row = line < inner;
                let own = 1 + line % inner;
                let site = |k: usize| if is_row { (own, k) } else { (k, own) };
                let crosses = |k: usize| if is_row { inner + k - 1 } else { k - 1 };
                let path = (1..=inner).map(|k| self.crossing(site(k).0, site(k).1));
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

/// Returns the point of a plane at a pixel.
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

/// `trisquare::internals::find_lattices` on a board or on random values.
pub fn find_lattices(data: &[u8]) -> Outcome {
    let bytes = &mut Bytes::new(data);
    let board = Board::drawn(bytes);
    let mut canvas = match bytes.once_in(8) {
        true => Canvas::garbage(bytes),
        false => board.canvas(bytes),
    };
    if bytes.once_in(3) {
        canvas.damage(bytes);
    }
    let mut reduced = vec![canvas.grey_bytes()];
    for _ in 0..bytes.below(3) {
        reduced.push(halved(&reduced[reduced.len() - 1]));
    }
    let pictures: Vec<_> = reduced
        .iter()
        .map(|(width, height, values)| GreyBytes::new(*width, *height, values))
        .map(|picture| picture.expect("the values fill the size"))
        .rev()
        .collect();
    // The searched pictures: without the photograph itself, only the photograph, or all.
    let whole = pictures[pictures.len() - 1];
    let searched = match bytes.below(4) {
        0 => &pictures[..pictures.len() - 1],
        1 => &pictures[pictures.len() - 1..],
        _ => &pictures[..],
    };
    let found = trisquare::internals::find_lattices(&whole, searched).lattices;
    for lattice in &found {
        assert!(lattice.count() >= 9 && lattice.size().iter().min() >= Some(&3));
        for (site, point) in lattice.found() {
            assert_eq!(lattice.at(site), Some(point));
            assert!(point.iter().all(|v| v.is_finite()), "{point}");
        }
    }
    assert!(found.is_sorted_by_key(|lattice| std::cmp::Reverse(lattice.count())));
    match found.len() {
        0 => "no lattice",
        _ => "Ok",
    }
}

/// Keeps every second pixel of every second row.
fn halved((width, height, values): &(usize, usize, Vec<u8>)) -> (usize, usize, Vec<u8>) {
    let rows = values.chunks(*width).step_by(2);
    let values = rows
        .flat_map(|row| row.iter().copied().step_by(2))
        .collect();
    (width.div_ceil(2), height.div_ceil(2), values)
}

/// `trisquare::localise` along the crossing lines of a board.
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
    if bytes.once_in(3) {
        return chessboard(&board, &picture, bytes);
    }
    if bytes.once_in(2) {
        let (found, estimate, _) = trisquare::localise_with_unknown_tone(&picture, &lines);
        assert!(estimate.picture_tone().is_valid(), "{estimate:?}");
        return measured_spans(&found);
    }
    let (found, ..) = trisquare::localise(&picture, &lines, bytes.tone());
    assert_eq!(found.len(), lines.len());
    measured_spans(&found)
}

/// `trisquare::Chessboard` from the crossings, some of which may be damaged or missing.
fn chessboard(board: &Board, picture: &Picture, bytes: &mut Bytes<'_>) -> Outcome {
    let row = |row| {
        (1..board.cells)
            .map(|column| board.crossing(row, column))
            .collect()
    };
    let mut corners: Vec<Vec<_>> = (1..board.cells).map(row).collect();
    let damaged = bytes.below(corners.len());
    match bytes.below(6) {
        0 => corners[damaged] = bytes.points(SIZE, 6),
        1 => corners[damaged].reverse(),
        2 => corners.truncate(damaged),
        3 => corners.reverse(),
        _ => {}
    }
    let Ok(known) = Chessboard::new(picture, &corners) else {
        return "refused";
    };
    let (found, ..) = trisquare::localise(picture, &known.spans(0), bytes.tone());
    measured_spans(&found);
    match known.edges(&found) {
        Ok(edges) => {
            assert_eq!(edges.check(0), Ok(()));
            "Ok, board"
        }
        Err(_) => "no board",
    }
}

fn damage_line(lines: &mut [EdgeSpan], bytes: &mut Bytes<'_>) {
    let line = bytes.below(lines.len());
    let any = (bytes.once_in(2)).then(|| bytes.below(2 * lines.len()));
    let span = &mut lines[line];
    let at = bytes.below(span.path.len().max(1));
    match bytes.below(11) {
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
        9 => {
            let count = bytes.below(8);
            span.tags = vec![vec![vec![bytes.once_in(2); count]; bytes.below(8)]; at];
            span.tag_border = bytes.coefficient();
        }
        // Hides a crossing.
        _ if at < span.path.len().min(span.crossings.len()) => {
            span.path.remove(at);
            span.crossings.remove(at);
        }
        _ => {}
    }
}
