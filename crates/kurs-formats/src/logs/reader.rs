//! Observations from a log, epoch by epoch.

use std::collections::BTreeMap;

use kurs::ephemeris::NavigationData;
use kurs::frames::{Ecef, Vector};
use kurs::observation::AntennaEpoch;
use kurs::time::{GpsTime, WEEK_S};

use super::dating::{Begin, Dating, MIDDLE_WEEK_NS};
use super::epochs::LogEpochs;
use super::file_date;
use super::frames::{FrameScanner, Protocol};
use super::interference::Statements;
use super::message::{MessageKind, Role};
use super::news::News;
use super::start::Start;
use crate::damage::{Damage, DamageLog};
use crate::epoch_order::Ordered;
use crate::fingerprint::Fingerprint;
use crate::sbf::AntennaId;
use crate::source::{ReadError, Source};

/// What a log does not say by itself.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LogOptions {
    /// The protocol whose observations are wanted; needed where there are several.
    pub protocol: Option<Protocol>,
    /// RTCM 3: the station whose observations are wanted; needed where there are several.
    pub station: Option<u16>,
    /// SBF: the antenna whose observations are wanted; needed where there are several.
    pub antenna: Option<AntennaId>,
    /// RTCM 3: a time within three days of the log, whatever its messages say.
    pub approximate_time: Option<GpsTime>,
    /// RTCM 3: a time within three days of the log as other files tell it; it counts where no
    /// message in the log tells the week.
    pub navigation_time: Option<GpsTime>,
    /// RTCM 3: where nothing tells the week, any will do ([`LogReader::is_dated`] says so).
    pub any_week: bool,
    /// The log is read as a live stream is: every epoch brings the navigation data that came before
    /// it ([`LogReader::take_news`]), and nothing waits for what comes behind if it need not.
    pub as_received: bool,
}

impl LogOptions {
    /// The protocol that is chosen, by name or by what only one of them has.
    pub(crate) fn chosen_protocol(&self) -> Option<Protocol> {
        self.protocol
            .or(self.station.map(|_| Protocol::Rtcm3))
            .or(self.antenna.map(|_| Protocol::Sbf))
    }

    /// A time within ten years of a log of this name, as far as one is known.
    pub(crate) fn near(&self, name: &str) -> Option<GpsTime> {
        self.approximate_time.or(self.navigation_time).or_else(|| file_date::of_name(name))
    }
}

/// Observations of one antenna from a receiver log.
///
/// Epochs come out with increasing times: one that is not later than the epoch before is skipped;
/// one that jumps far ahead is skipped if the next one is earlier.
#[derive(Debug)]
pub struct LogReader {
    epochs: Ordered<LogEpochs>,
    is_dated: bool,
}

impl LogReader {
    /// Reads a log from its start, which `start` has looked into.
    ///
    /// # Errors
    ///
    /// [`ReadError::WrongContent`] if it is an RTCM 3 log whose date is not known, or if a station
    /// or antenna is chosen and the protocol has none.
    pub(crate) fn new(
        source: Source,
        found: Protocol,
        options: &LogOptions,
        start: Start,
    ) -> Result<Self, ReadError> {
        const DATE: &str = "a message that does (1019, 1020, 1042, 1044, 1045 or 1046), navigation \
            files or a file name of the time, or the key `approximate_time`, a time within three days \
            of the log";
        let found = start.found.unwrap_or(found);
        let protocol = start.observing.or(options.protocol).unwrap_or(found);
        if options.antenna.is_some() && protocol != Protocol::Sbf {
            let antenna =
                "Septentrio blocks (SBF), because `antenna_id` chooses one of their antennas";
            return Err(source.wrong_content(found.to_string(), antenna));
        }
        if options.station.is_some() && protocol != Protocol::Rtcm3 {
            let station = "RTCM 3 messages, because `station_id` chooses one of their stations";
            return Err(source.wrong_content(found.to_string(), station));
        }
        let mut damage = DamageLog::default();
        let begin = begin(source.name(), options, start, &mut damage);
        let is_dated = protocol != Protocol::Rtcm3 || begin.is_some();
        if !is_dated && !options.any_week {
            return Err(source.wrong_content("RTCM 3 messages that do not tell the week", DATE));
        }
        let begin = begin
            .unwrap_or(Begin { time: GpsTime::from_nanoseconds(MIDDLE_WEEK_NS), is_weekly: true });
        let epochs = LogEpochs::new(source, protocol, options, begin, damage);
        let epochs =
            if options.as_received { Ordered::prompt(epochs) } else { Ordered::new(epochs) };
        Ok(Self { epochs, is_dated })
    }

    /// Reads a stream as it comes, for whose first message with observations it waits.
    /// `options.as_received` is taken for granted.
    ///
    /// # Errors
    ///
    /// [`ReadError`] if the stream breaks off or ends without any observation, or if a station or
    /// an antenna is chosen and the protocol has none, or if `approximate_time` is needed and not
    /// given.
    pub fn of_stream(mut source: Source, options: &LogOptions) -> Result<Self, ReadError> {
        const OBSERVATIONS: &str = "messages with observations: RXM-RAWX (UBX), MSM 4 to 7 or 1004 and \
            1012 (RTCM 3) or MeasEpoch (SBF)";
        let mut options = LogOptions { as_received: true, ..*options };
        let chosen = options.chosen_protocol();
        let (mut scanner, mut damage) = (FrameScanner::default(), DamageLog::default());
        let mut news = News::new(options.approximate_time);
        let mut dating = Dating::new(options.approximate_time);
        let mut interference = Statements::default();
        let antenna = options.antenna.map(|antenna| u16::from(antenna.0));
        let protocol = loop {
            let Some(frame) = scanner.next(&mut source, &mut damage)? else {
                return Err(source.wrong_content("no observations", OBSERVATIONS));
            };
            dating.take(&frame);
            let is_wanted = chosen.is_none_or(|chosen| chosen == frame.protocol);
            if is_wanted && MessageKind::of(&frame).role() == Role::Observations {
                break frame.protocol;
            }
            if let Some(told) = news.gather(&frame, &mut damage) {
                // Before the first epoch nothing has been dated by the wrong week yet.
                options.approximate_time = Some(told);
                news.set_time(told);
            }
            interference.take(&frame, antenna, &mut damage);
        };
        scanner.give_again();
        let start = Start { observing: Some(protocol), found: Some(protocol), dating };
        let mut reader = Self::new(source, protocol, &options, start)?;
        reader.epochs.raw.go_on_from(scanner, damage, news, interference);
        reader.epochs.follow_clock_set_back();
        Ok(reader)
    }

    /// Navigation data that came before the first message of the epoch that was read last and after
    /// that of the epoch before; nothing unless the log is read as received.
    pub fn take_news(&mut self) -> NavigationData {
        self.epochs.raw.news_before(self.epochs.place)
    }

    /// Byte offset of the first message with observations of the epoch that was read last.
    #[must_use]
    pub const fn begun_at(&self) -> u64 {
        self.epochs.place
    }

    /// RTCM 3, as received: the date that ephemerides tell, where it ended the reading because the
    /// week in force is another one.
    #[must_use]
    pub const fn told_date(&self) -> Option<GpsTime> {
        self.epochs.raw.told_date
    }

    /// Reads the next epoch into `epoch`; `false` (and no observations) at the end of the log.
    ///
    /// # Errors
    ///
    /// [`ReadError::Io`] if the operating system refuses to read on; [`ReadError::WrongContent`] if
    /// there are several protocols, stations or antennas with observations and none was chosen, or
    /// the chosen one is not there.
    pub fn next_epoch(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        self.epochs.next_epoch(epoch)
    }

    /// The protocol whose observations are read.
    #[must_use]
    pub const fn protocol(&self) -> Protocol {
        self.epochs.raw.protocol
    }

    /// Whether the week is known; if not, all times are of some other week.
    #[must_use]
    pub const fn is_dated(&self) -> bool {
        self.is_dated
    }

    /// Where a station in the log says that its antenna is (its reference point); as of the last
    /// message.
    #[must_use]
    pub const fn place_m(&self) -> Option<Vector<Ecef>> {
        self.epochs.raw.place
    }

    /// GLONASS frequency channel of each orbital slot that was seen so far.
    #[must_use]
    pub const fn glonass_channels(&self) -> &BTreeMap<u8, i8> {
        &self.epochs.raw.glonass_channels
    }

    /// What was skipped so far, the first [`DamageLog::LISTED_MAX`] entries of it.
    #[must_use]
    pub fn damage(&self) -> &[Damage] {
        self.epochs.raw.damage.listed()
    }

    /// How much was skipped so far, the unlisted included.
    #[must_use]
    pub const fn damage_count(&self) -> u64 {
        self.epochs.raw.damage.total()
    }

    /// Name of the file.
    #[must_use]
    pub fn name(&self) -> &str {
        self.epochs.raw.source.name()
    }

    /// Bytes of the file that were read so far.
    #[must_use]
    pub fn bytes_read(&self) -> u64 {
        self.epochs.raw.source.bytes_read()
    }

    /// What the file holds, once it was read to its end.
    #[must_use]
    pub fn fingerprint(&self) -> Option<Fingerprint> {
        self.epochs.raw.source.fingerprint()
    }
}

/// Where an RTCM 3 log begins: by the key, its own ephemerides, other files, its name.
/// Disagreements are noted.
fn begin(name: &str, options: &LogOptions, start: Start, damage: &mut DamageLog) -> Option<Begin> {
    let dating = start.dating;
    let others = [
        (options.navigation_time, "the navigation files are"),
        (file_date::of_name(name), "the name of the file is"),
    ];
    let by_date =
        |date: GpsTime| dating.begin_near(date).unwrap_or(Begin { time: date, is_weekly: true });
    if let Some(date) = options.approximate_time {
        return Some(by_date(date));
    }
    let by_others = others.iter().find_map(|(date, _)| date.map(by_date));
    let Some(begin) = dating.begin() else { return by_others };
    for (date, what) in others {
        if let Some(date) = date.filter(|date| (*date - begin.time).abs() > WEEK_S) {
            damage.note(0, format!("the log is of {}, {what} of {date}", begin.time));
        }
    }
    Some(begin)
}
