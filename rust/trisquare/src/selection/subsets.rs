//! Pairs and triples of candidates, evenly chosen if there are many.

/// Maximum number of pairs and triples of candidates whose camera is computed.
const MAX_SUBSETS: usize = 160;

/// Maximum number of candidates that are combined.
const MAX_COMBINED: usize = 24;

/// Pairs and triples of `count` candidates, evenly chosen.
pub(super) fn subsets(count: usize) -> Vec<Vec<usize>> {
    let indices: Vec<usize> = (0..count)
        .step_by(count.div_ceil(MAX_COMBINED).max(1))
        .collect();
    let mut all = Vec::new();
    for (i, a) in indices.iter().enumerate() {
        for (j, b) in indices.iter().enumerate().skip(i + 1) {
            all.push(vec![*a, *b]);
            all.extend(indices[j + 1..].iter().map(|c| vec![*a, *b, *c]));
        }
    }
    let step = all.len().div_ceil(MAX_SUBSETS).max(1);
    all.into_iter().step_by(step).collect()
}

/// Triples of candidates, evenly chosen if there are more than `max_count`.
pub(super) fn triples(indices: &[usize], max_count: usize) -> Vec<[usize; 3]> {
    let mut all = Vec::new();
    for (i, a) in indices.iter().enumerate().take(MAX_COMBINED) {
        for (j, b) in indices.iter().enumerate().take(MAX_COMBINED).skip(i + 1) {
            let rest = indices.iter().take(MAX_COMBINED).skip(j + 1);
            all.extend(rest.map(|c| [*a, *b, *c]));
        }
    }
    let step = all.len().div_ceil(max_count).max(1);
    all.into_iter().step_by(step).collect()
}
