//! The same work for each of many items: sequentially, or in the threads of a pool.

#[cfg(feature = "rayon")]
use std::sync::OnceLock;

/// Number of items below which the work is sequential: a thread would take longer to wake up than
/// to do its part.
#[cfg(feature = "rayon")]
const MIN_PARALLEL_COUNT: usize = 16;

/// The results of `work` for the indices from 0 to `count`, in order; `None` if one of them is
/// `None`.
///
/// With the feature `rayon`, and if called in a thread of one of its pools, the threads of that
/// pool share the work. The results are bitwise the same.
pub(crate) fn each<T: Send + Sync>(
    count: usize,
    work: impl Fn(usize) -> Option<T> + Sync + Send,
) -> Option<Vec<T>> {
    #[cfg(feature = "rayon")]
    if count >= MIN_PARALLEL_COUNT && rayon::current_thread_index().is_some() {
        let slots: Vec<OnceLock<Option<T>>> = (0..count).map(|_| OnceLock::new()).collect();
        run_in_pool(count, &|i| {
            slots[i].get_or_init(|| work(i));
        });
        return slots.into_iter().map(|slot| slot.into_inner()?).collect();
    }
    (0..count).map(work).collect()
}

/// Does the work in the threads of the pool. Not generic, so that it is compiled only once: rayon
/// is large.
#[cfg(feature = "rayon")]
fn run_in_pool(count: usize, work: &(dyn Fn(usize) + Sync)) {
    use rayon::iter::{IntoParallelIterator, ParallelIterator};
    (0..count).into_par_iter().for_each(work);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_without_a_result_leaves_none() {
        assert_eq!(each(3, Some), Some(vec![0, 1, 2]));
        assert_eq!(each(100, |i| (i != 70).then_some(i)), None);
    }

    #[cfg(feature = "rayon")]
    #[test]
    fn many_are_shared_among_the_threads_of_a_pool_and_come_back_in_order() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build();
        let found = pool.unwrap().install(|| {
            each(100, |i| {
                assert!(rayon::current_thread_index().is_some());
                Some(i)
            })
        });
        assert_eq!(found, Some((0..100).collect()));
    }
}
