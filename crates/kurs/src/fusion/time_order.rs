//! Late measurements put back in their place: items wait for a fixed window and leave in the order
//! of their times.

use std::collections::VecDeque;

/// Items that wait.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeOrder<T> {
    window_s: f64,
    waiting: VecDeque<(f64, T)>,
    newest_s: f64,
    released_s: f64,
}

/// An item came after others that followed it had left.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("measurement of {time_s} s came too late: {released_s} s is already used")]
pub struct TooLate {
    /// Its time.
    pub time_s: f64,
    /// Time of the last item that left.
    pub released_s: f64,
}

impl<T> TimeOrder<T> {
    /// Items wait until one that is `window_s` newer has come.
    #[must_use]
    pub const fn new(window_s: f64) -> Self {
        Self {
            window_s,
            waiting: VecDeque::new(),
            newest_s: f64::NEG_INFINITY,
            released_s: f64::NEG_INFINITY,
        }
    }

    /// Takes an item.
    ///
    /// # Errors
    ///
    /// [`TooLate`] if newer items have left already, or the time is not a number.
    pub fn push(&mut self, time_s: f64, item: T) -> Result<(), TooLate> {
        if time_s.is_nan() || time_s < self.released_s {
            return Err(TooLate { time_s, released_s: self.released_s });
        }
        // Behind everything not newer: equal times keep their order. Mostly at the end.
        let behind = self.waiting.iter().rev().take_while(|(other, _)| *other > time_s).count();
        self.waiting.insert(self.waiting.len() - behind, (time_s, item));
        self.newest_s = self.newest_s.max(time_s);
        Ok(())
    }

    /// The oldest item that has waited long enough.
    pub fn pop(&mut self) -> Option<(f64, T)> {
        let ready = self.waiting.front().is_some_and(|(t, _)| *t <= self.newest_s - self.window_s);
        if ready { self.release() } else { None }
    }

    /// The items that wait, in the order of their times.
    pub fn waiting(&self) -> impl Iterator<Item = (f64, &T)> {
        self.waiting.iter().map(|(time_s, item)| (*time_s, item))
    }

    /// The oldest item, however short it waited: at the end of the data.
    pub fn drain(&mut self) -> Option<(f64, T)> {
        self.release()
    }

    fn release(&mut self) -> Option<(f64, T)> {
        let (time_s, item) = self.waiting.pop_front()?;
        self.released_s = time_s;
        Some((time_s, item))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn late_inside_the_window_is_put_in_place() {
        let mut order = TimeOrder::new(0.2);
        for time_s in [0.0, 0.1, 0.3, 0.2, 0.4] {
            order.push(time_s, ()).unwrap();
        }
        let times: Vec<f64> = core::iter::from_fn(|| order.pop()).map(|(t, ())| t).collect();
        assert_eq!(times, [0.0, 0.1, 0.2]);
        assert_eq!(order.push(0.05, ()), Err(TooLate { time_s: 0.05, released_s: 0.2 }));
        assert!(order.push(f64::NAN, ()).is_err());
    }

    proptest! {
        #[test]
        fn leaves_in_order_and_complete(times in prop::collection::vec(0.0..10.0f64, 0..60)) {
            let mut order = TimeOrder::new(20.0);
            times.iter().for_each(|time_s| order.push(*time_s, ()).unwrap());
            let left: Vec<f64> = core::iter::from_fn(|| order.drain()).map(|(t, ())| t).collect();
            let mut sorted = times;
            sorted.sort_by(f64::total_cmp);
            prop_assert_eq!(left, sorted);
        }
    }
}
