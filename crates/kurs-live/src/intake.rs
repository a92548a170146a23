//! What the service keeps of every source of bytes: what is shown of it, and how far it may run
//! ahead.

use std::sync::{Arc, Condvar, Mutex, PoisonError};

use crate::input::{Input, Observer};
use crate::lines::Lines;
use crate::lock::lock;
use crate::status::{Brings, StreamStatus};

/// One source: an antenna, the station, the inertial sensor or another body.
#[derive(Debug, Clone)]
pub(crate) struct Intake {
    pub(crate) status: Arc<StreamStatus>,
    pub(crate) permits: Arc<Permits>,
}

/// Lets a decoder run ahead of the other antennas only so far.
#[derive(Debug, Default)]
pub(crate) struct Permits {
    out: Mutex<usize>,
    changed: Condvar,
}

impl Permits {
    /// Waits until fewer than `most` are out.
    pub(crate) fn acquire(&self, most: usize) {
        let out = self.changed.wait_while(lock(&self.out), |out| *out >= most);
        *out.unwrap_or_else(PoisonError::into_inner) += 1;
    }

    /// Gives `count` of them back.
    pub(crate) fn release(&self, count: usize) {
        let mut out = lock(&self.out);
        *out = out.saturating_sub(count);
        self.changed.notify_all();
    }
}

/// All sources of a service.
pub(crate) struct Intakes {
    pub(crate) antennas: Vec<Intake>,
    /// There is one even without a station: a reload may bring it.
    pub(crate) station: Intake,
    pub(crate) imu: Option<Intake>,
    peers: Vec<Intake>,
}

impl Intakes {
    /// Those of so many antennas, and of what else the inputs bring.
    pub(crate) fn new(inputs: &[Input], antennas: usize) -> Self {
        let of_observer = |observer| {
            let found = inputs.iter().find_map(|input| Some((input, input.name_of(observer)?)));
            let name = found.map_or("station", |(_, name)| name);
            intake(name, found.map(|(input, _)| input), Brings::Epochs)
        };
        let of_lines = |brings| move |input: &Input| intake(input.name(), Some(input), brings);
        let imu = inputs.iter().find(|input| input.lines == Some(Lines::Imu));
        let peers = inputs.iter().filter(|input| input.is_optional());
        Self {
            antennas: (0..antennas).map(|number| of_observer(Observer::Antenna(number))).collect(),
            station: of_observer(Observer::Station),
            imu: imu.map(of_lines(Brings::Samples)),
            peers: peers.map(of_lines(Brings::Peer)).collect(),
        }
    }

    /// The sources of an input, in its order.
    pub(crate) fn of(&self, input: &Input) -> Vec<Intake> {
        match &input.lines {
            Some(Lines::Imu) => self.imu.iter().cloned().collect(),
            Some(Lines::Peer(number, _)) => vec![self.peers[*number].clone()],
            None => input.antennas.iter().map(|(of, ..)| self.of_observer(*of).clone()).collect(),
        }
    }

    fn of_observer(&self, observer: Observer) -> &Intake {
        match observer {
            Observer::Antenna(number) => &self.antennas[number],
            Observer::Station => &self.station,
        }
    }

    /// What is shown of them, in this order.
    pub(crate) fn statuses(&self, has_station: bool) -> Vec<Arc<StreamStatus>> {
        let station = has_station.then_some(&self.station);
        let all = self.antennas.iter().chain(station).chain(&self.imu).chain(&self.peers);
        all.map(|intake| Arc::clone(&intake.status)).collect()
    }
}

fn intake(name: &str, input: Option<&Input>, brings: Brings) -> Intake {
    let baud = input.and_then(|input| input.address.baud());
    let status = StreamStatus::new(name.to_owned(), baud).bringing(brings);
    Intake { status: Arc::new(status), permits: Arc::default() }
}
