//! Contours of the regions of a picture above a level, and of the holes in them.
//!
//! Border following: S. Suzuki, K. Abe, Computer Vision, Graphics, and Image Processing 30 (1985)
//! 32-46. A noisy picture has thousands of contours of a few pixels; contours that are too small
//! are dropped as soon as they have been followed.

use crate::image::GreyBytes;

/// Steps to the eight neighbours, anticlockwise on the screen (x right, y down) from the right.
const STEPS: [[i32; 2]; 8] = [
    [1, 0],
    [1, -1],
    [0, -1],
    [-1, -1],
    [-1, 0],
    [-1, 1],
    [0, 1],
    [1, 1],
];
const RIGHT: usize = 0;
const LEFT: usize = 4;

/// States of a cell: outside of all regions, or inside, and whether a contour has passed it. A
/// contour that passed with the outside on its right has marked where a hole or the outside begins.
const OUTSIDE: u8 = 0;
const INSIDE: u8 = 1;
const FOLLOWED: u8 = 2;
const FOLLOWED_RIGHT: u8 = 3;

/// Number of cells that are compared at a time.
const RUN: usize = 8;

/// Limits of the contours to keep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ContourLimits {
    /// Minimum number of pixels on the contour.
    pub points: usize,
    /// Minimum shorter side of its bounding box, pixels.
    pub side: i32,
    /// Minimum enclosed area, in square pixels.
    pub area: f64,
    /// Minimum enclosed area over the squared number of points.
    pub compactness: f64,
    /// Minimum distance of its bounding box from the picture's border, pixels.
    pub margin: i32,
    /// Whether to keep contours of holes, too.
    pub holes: bool,
}

/// A contour as a closed sequence of adjacent pixels.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Contour {
    /// Columns and rows, anticlockwise on the screen for regions, clockwise for holes.
    pub points: Vec<[i32; 2]>,
    /// Area enclosed by the centres of the pixels, in square pixels; negative for regions.
    pub area: f64,
}

/// Contours of the regions of a picture above each of some levels, and of the holes in them. Those
/// of a level are in reverse row order of their first pixels.
///
/// Regions are connected by sides and corners, and end at the picture's border.
pub(super) fn contours(
    picture: &GreyBytes<'_>,
    levels: &[u8],
    limits: &ContourLimits,
) -> Vec<Vec<Contour>> {
    let mut map = Map::of(picture.size());
    let level_contours = |level: &u8| {
        map.fill(picture.values(), *level);
        let mut kept = map.contours(limits);
        kept.reverse();
        kept
    };
    levels.iter().map(level_contours).collect()
}

impl ContourLimits {
    fn admits(&self, points: &[[i32; 2]], area: f64, size: [i32; 2]) -> bool {
        let count = points.len();
        let min_area = self.area.max(self.compactness * (count * count) as f64);
        if count < self.points || area.abs() < min_area {
            return false;
        }
        let (mut low, mut high) = (points[0], points[0]);
        for point in points {
            for axis in 0..2 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        (0..2).all(|axis| {
            high[axis] - low[axis] + 1 >= self.side
                && low[axis].min(size[axis] - 1 - high[axis]) >= self.margin
        })
    }
}

/// The cells of a picture that are inside of regions, with a border of cells that are outside.
struct Map {
    size: [usize; 2],
    stride: usize,
    /// Index differences to each of the neighbours.
    steps: [isize; 8],
    cells: Vec<u8>,
}

impl Map {
    fn of(size: [usize; 2]) -> Self {
        let stride = size[0] + 2;
        Self {
            size,
            stride,
            steps: STEPS.map(|[x, y]| x as isize + y as isize * stride as isize),
            cells: vec![OUTSIDE; (size[1] + 2) * stride],
        }
    }

    /// Marks the regions above a level.
    fn fill(&mut self, values: &[u8], level: u8) {
        let rows = self.cells.chunks_exact_mut(self.stride).skip(1);
        for (cells, values) in rows.zip(values.chunks_exact(self.size[0])) {
            for (cell, value) in cells[1..].iter_mut().zip(values) {
                *cell = u8::from(*value > level);
            }
        }
    }

    /// The contours, in row order of their first pixels.
    fn contours(&mut self, limits: &ContourLimits) -> Vec<Contour> {
        let size = self.size.map(|side| side as i32);
        let mut kept = Vec::new();
        let mut points = Vec::new();
        for row in 0..self.size[1] {
            let start = (row + 1) * self.stride;
            let end = start + self.stride;
            let mut position = start + 1;
            let mut before = OUTSIDE;
            while let Some(place) = self.next_change(position, end, before) {
                let cell = self.cells[place];
                let is_region = before == OUTSIDE && cell == INSIDE;
                let is_hole = cell == OUTSIDE && before != FOLLOWED_RIGHT;
                position = place + 1;
                if is_region || is_hole {
                    let column = (place - start - 1) as i32 - i32::from(is_hole);
                    let first = place - usize::from(is_hole);
                    points.clear();
                    let doubled_area =
                        self.follow(first, [column, row as i32], is_hole, &mut points);
                    let area = 0.5 * doubled_area as f64;
                    if (limits.holes || !is_hole) && limits.admits(&points, area, size) {
                        kept.push(Contour {
                            points: points.clone(),
                            area,
                        });
                    }
                }
                before = self.cells[place];
            }
        }
        kept
    }

    /// The first cell from `position` to before `end` that differs from the one before it.
    fn next_change(&self, position: usize, end: usize, before: u8) -> Option<usize> {
        let row = self.cells.get(position..end)?;
        let same_cells = [before; RUN];
        let mut skipped = 0;
        for run in row.as_chunks::<RUN>().0 {
            if *run != same_cells {
                break;
            }
            skipped += RUN;
        }
        for (number, cell) in row[skipped..].iter().enumerate() {
            if *cell != before {
                return Some(position + skipped + number);
            }
        }
        None
    }

    fn neighbour(&self, cell: usize, direction: usize) -> usize {
        cell.wrapping_add_signed(self.steps[direction & 7])
    }

    /// Follows a contour from its first pixel, and returns twice the area that it encloses.
    fn follow(
        &mut self,
        first: usize,
        pixel: [i32; 2],
        is_hole: bool,
        points: &mut Vec<[i32; 2]>,
    ) -> i64 {
        // The last pixel is the next neighbour of the first, clockwise from the cell that is
        // outside.
        let outside = if is_hole { RIGHT } else { LEFT };
        let is_inside =
            |turn: &usize| self.cells[self.neighbour(first, outside + 8 - turn)] != OUTSIDE;
        let Some(turn) = (1..8).find(is_inside) else {
            self.cells[first] = FOLLOWED_RIGHT;
            points.push(pixel);
            return 0;
        };
        let mut back = (outside + 8 - turn) & 7;
        let last = self.neighbour(first, back);
        let (mut cell, [mut x, mut y]) = (first, pixel);
        let mut doubled_area = 0;
        loop {
            // Anticlockwise from the previous pixel, which is found again if there is no other.
            let mut direction = back + 1;
            while self.cells[self.neighbour(cell, direction)] == OUTSIDE {
                direction += 1;
            }
            // The search has passed the right-hand neighbour, which is then outside.
            if direction > 8 {
                self.cells[cell] = FOLLOWED_RIGHT;
            } else if self.cells[cell] == INSIDE {
                self.cells[cell] = FOLLOWED;
            }
            direction &= 7;
            points.push([x, y]);
            let [dx, dy] = STEPS[direction];
            doubled_area += i64::from(x * dy - y * dx);
            let next = self.neighbour(cell, direction);
            if next == first && cell == last {
                return doubled_area;
            }
            (x, y) = (x + dx, y + dy);
            (cell, back) = (next, (direction + 4) & 7);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EVERYTHING: ContourLimits = ContourLimits {
        points: 1,
        side: 1,
        area: 0.0,
        compactness: 0.0,
        margin: 0,
        holes: true,
    };

    /// Regions as `#` in rows of one width.
    fn drawn(rows: &[&str], limits: &ContourLimits) -> Vec<Contour> {
        let values: Vec<u8> = rows
            .concat()
            .bytes()
            .map(|it| u8::from(it == b'#'))
            .collect();
        let picture = GreyBytes::new(rows[0].len(), rows.len(), &values).unwrap();
        contours(&picture, &[0], limits).concat()
    }

    #[test]
    fn a_region_runs_anticlockwise_and_the_hole_in_it_clockwise() {
        let rows = ["#####", "#...#", "#####"];
        let [hole, region] = &drawn(&rows, &EVERYTHING)[..] else {
            panic!("a region and a hole")
        };
        assert_eq!((region.area, region.points.len()), (-8.0, 12));
        assert_eq!(region.points[..3], [[0, 0], [0, 1], [0, 2]]);
        // The area of the hole is that within the centres of the pixels around it.
        assert_eq!((hole.area, hole.points.len()), (6.0, 8));
        let without_holes = ContourLimits {
            holes: false,
            ..EVERYTHING
        };
        assert_eq!(drawn(&rows, &without_holes), std::slice::from_ref(region));
    }

    #[test]
    fn every_region_and_every_hole_is_followed_once() {
        let rows = [
            "#..##.....",
            ".#.##..###",
            "#......#.#",
            "..#.#..###",
            ".#.#......",
            "#....##.##",
        ];
        let found = drawn(&rows, &EVERYTHING);
        let holes = found.iter().filter(|contour| contour.area > 0.0).count();
        let starts: std::collections::HashSet<_> = found
            .iter()
            .map(|it| (it.points[0], it.area > 0.0))
            .collect();
        // Regions whose corners touch are joined, and a region of one pixel has no area.
        assert_eq!((found.len(), holes, starts.len()), (7, 1, 7));
        for contour in &found {
            let around = contour
                .points
                .iter()
                .zip(contour.points.iter().cycle().skip(1));
            for (a, b) in around {
                assert!((0..2).all(|axis| a[axis].abs_diff(b[axis]) <= 1));
                assert_eq!(rows[a[1] as usize].as_bytes()[a[0] as usize], b'#');
            }
        }
    }

    #[test]
    fn what_is_too_small_or_ragged_or_at_the_border_is_left_out() {
        let rows = ["####..", "####..", "....#.", "####.."];
        let kept = |limits: ContourLimits| drawn(&rows, &limits).len();
        assert_eq!(kept(EVERYTHING), 1);
        assert_eq!(
            kept(ContourLimits {
                side: 5,
                ..EVERYTHING
            }),
            0
        );
        assert_eq!(
            kept(ContourLimits {
                margin: 1,
                ..EVERYTHING
            }),
            0
        );
        let rows = ["......", ".####.", ".####.", ".####.", "......"];
        let kept = |limits: ContourLimits| drawn(&rows, &limits).len();
        for (limits, most) in [
            (
                ContourLimits {
                    side: 3,
                    ..EVERYTHING
                },
                ContourLimits {
                    side: 4,
                    ..EVERYTHING
                },
            ),
            (
                ContourLimits {
                    area: 6.0,
                    ..EVERYTHING
                },
                ContourLimits {
                    area: 6.5,
                    ..EVERYTHING
                },
            ),
            (
                ContourLimits {
                    compactness: 0.06,
                    ..EVERYTHING
                },
                ContourLimits {
                    compactness: 0.061,
                    ..EVERYTHING
                },
            ),
            (
                ContourLimits {
                    points: 10,
                    ..EVERYTHING
                },
                ContourLimits {
                    points: 11,
                    ..EVERYTHING
                },
            ),
            (
                ContourLimits {
                    margin: 1,
                    ..EVERYTHING
                },
                ContourLimits {
                    margin: 2,
                    ..EVERYTHING
                },
            ),
        ] {
            assert_eq!((kept(limits), kept(most)), (1, 0), "{limits:?}");
        }
    }

    #[test]
    fn levels_are_searched_one_by_one() {
        let values: Vec<u8> = (0..100).map(|index| 10 * (index / 10)).collect();
        let picture = GreyBytes::new(10, 10, &values).unwrap();
        let found = contours(&picture, &[0, 40, 90, 255], &EVERYTHING);
        let heights: Vec<Vec<usize>> = found
            .iter()
            .map(|own| own.iter().map(|contour| contour.points.len()).collect())
            .collect();
        assert_eq!(heights, [vec![34], vec![26], vec![], vec![]]);
    }
}
