//! Epochs put together from messages: each has those of one time.
//!
//! A message of another time begins a new epoch. Where the time goes back or jumps ahead, the next
//! message must confirm it: one message that comes from somewhere else costs nothing.

use std::collections::{BTreeMap, VecDeque};

use kurs::observation::AntennaEpoch;
use kurs::signal::System;
use kurs::time::GpsTime;

use super::clock::{self, Day};
use super::prompt_end::PromptEnd;
use super::{ObservationDecoder, ObservationHeader};
use crate::damage::DamageLog;
use crate::epoch_order::JUMP_STEPS;
use crate::logs::dating::Begin;

/// Less than a whole day apart are times that differ in nothing but the leap seconds.
const HALF_A_DAY_S: f64 = 43_200.0;

/// An epoch, and the offset of its first message.
pub(crate) type Placed = (AntennaEpoch, u64);

/// A message with observations and its time.
#[derive(Debug)]
struct Message {
    time: GpsTime,
    offset: u64,
    more_follows: bool,
    body: Vec<u8>,
}

/// Takes messages in one after the other and gives epochs out.
#[derive(Debug)]
pub(crate) struct EpochBuilder {
    decoder: ObservationDecoder,
    begin: Begin,
    open: Option<Placed>,
    /// A message of another time than the open epoch's, to be confirmed by the next one.
    held: Option<Message>,
    /// What comes behind an epoch that was given out.
    waiting: VecDeque<Message>,
    /// Time of the epoch that was opened last.
    last: Option<GpsTime>,
    shortest_step_s: Option<f64>,
    /// Systems whose days were found wrong.
    wrong_days: Vec<System>,
    /// Whether an epoch ends before the next one begins; only for a log that is read as received.
    prompt_end: Option<PromptEnd>,
}

impl EpochBuilder {
    pub(crate) fn new(begin: Begin, as_received: bool) -> Self {
        Self {
            prompt_end: as_received.then(PromptEnd::default),
            decoder: ObservationDecoder::default(),
            begin,
            open: None,
            held: None,
            waiting: VecDeque::new(),
            last: None,
            shortest_step_s: None,
            wrong_days: Vec::new(),
        }
    }

    /// Takes a message in; an epoch if one ends with it.
    pub(crate) fn take(
        &mut self,
        header: &ObservationHeader,
        body: &[u8],
        offset: u64,
        glonass_channels: &mut BTreeMap<u8, i8>,
        damage: &mut DamageLog,
    ) -> Option<Placed> {
        let Some(time) = self.time(header, offset, damage) else {
            damage.note(offset, "the epoch time is none, message skipped");
            return None;
        };
        let more_follows = header.more_follows;
        let message = Message { time, offset, more_follows, body: body.to_vec() };
        self.put(message, glonass_channels, damage)
    }

    /// The time of the last message, or where the log begins.
    pub(crate) fn now(&self) -> GpsTime {
        self.last.unwrap_or(self.begin.time)
    }

    /// An epoch that ends with what was taken in before.
    pub(crate) fn next_waiting(
        &mut self,
        glonass_channels: &mut BTreeMap<u8, i8>,
        damage: &mut DamageLog,
    ) -> Option<Placed> {
        while let Some(message) = self.waiting.pop_front() {
            let complete = self.put(message, glonass_channels, damage);
            if complete.is_some() {
                return complete;
            }
        }
        self.close_promptly()
    }

    /// The last epochs, at the end of the log.
    pub(crate) fn end(
        &mut self,
        glonass_channels: &mut BTreeMap<u8, i8>,
        damage: &mut DamageLog,
    ) -> Option<Placed> {
        if let Some(complete) = self.close() {
            return Some(complete);
        }
        let held = self.held.take()?;
        self.open(&held, glonass_channels, damage);
        self.close()
    }

    /// The time of a message. Days of GLONASS and SBAS are believed only where no other system says
    /// what day it is.
    fn time(
        &mut self,
        header: &ObservationHeader,
        offset: u64,
        damage: &mut DamageLog,
    ) -> Option<GpsTime> {
        let near = self.last.unwrap_or(self.begin.time);
        let stated = clock::resolve(header, near, Day::Stated);
        if clock::is_weekly(header) || !self.begin.is_weekly {
            return stated;
        }
        let nearest = clock::resolve(header, near, Day::Nearest)?;
        if stated.is_some_and(|stated| (stated - nearest).abs() > HALF_A_DAY_S)
            && !self.wrong_days.contains(&header.system)
        {
            self.wrong_days.push(header.system);
            damage.note_with(offset, || {
                let system = header.system;
                format!(
                    "{system} states another day than the other systems: its days are taken as unknown"
                )
                .into()
            });
        }
        Some(nearest)
    }

    fn put(
        &mut self,
        message: Message,
        glonass_channels: &mut BTreeMap<u8, i8>,
        damage: &mut DamageLog,
    ) -> Option<Placed> {
        let time = message.time;
        let Some(open) = self.open.as_ref().map(|(epoch, _)| epoch.time) else {
            if let Some(end) = self.prompt_end.as_mut().filter(|_| self.last == Some(time)) {
                end.came_behind();
            }
            self.open(&message, glonass_channels, damage);
            return self.close_promptly();
        };
        if self.follows(open, time) {
            self.held.take().iter().for_each(|stray| note_stray(stray, damage));
            let complete = if time == open { None } else { self.close() };
            self.open(&message, glonass_channels, damage);
            return complete.or_else(|| self.close_promptly());
        }
        match self.held.take() {
            Some(held) if confirms(open, held.time, time) => {
                let complete = self.close();
                self.open(&held, glonass_channels, damage);
                self.waiting.push_back(message);
                complete
            }
            stray => {
                stray.iter().for_each(|stray| note_stray(stray, damage));
                self.held = Some(message);
                None
            }
        }
    }

    /// Whether a message of time `to` belongs to the open epoch or begins the next one.
    fn follows(&self, open: GpsTime, to: GpsTime) -> bool {
        let is_step = |step_s: f64| to > open && to - open <= JUMP_STEPS * step_s;
        let is_first_step = self.prompt_end.is_some() && to > open;
        to == open || self.shortest_step_s.map_or(is_first_step, is_step)
    }

    /// Adds a message to the open epoch, or opens one with it.
    fn open(
        &mut self,
        message: &Message,
        glonass_channels: &mut BTreeMap<u8, i8>,
        damage: &mut DamageLog,
    ) {
        let Message { time, offset, more_follows, ref body } = *message;
        if let Some(step_s) = self.last.map(|last| time - last).filter(|step_s| *step_s > 0.0) {
            self.shortest_step_s = Some(self.shortest_step_s.map_or(step_s, |s| s.min(step_s)));
        }
        self.last = Some(time);
        match &mut self.prompt_end {
            Some(end) if self.open.is_none() => end.begin(more_follows),
            Some(end) => end.go_on(more_follows),
            None => {}
        }
        let (epoch, _) = self
            .open
            .get_or_insert_with(|| (AntennaEpoch { time, ..AntennaEpoch::default() }, offset));
        if self.decoder.add(body, time, glonass_channels, &mut epoch.observations).is_none() {
            damage.note(offset, "the message is shorter than its masks say, skipped");
        }
    }

    /// The open epoch, if its last message says that it is the last and can be believed.
    fn close_promptly(&mut self) -> Option<Placed> {
        self.prompt_end.as_ref().filter(|end| end.is_complete())?;
        self.close()
    }

    fn close(&mut self) -> Option<Placed> {
        let mut complete = self.open.take()?;
        self.decoder.finish(&mut complete.0.observations);
        Some(complete)
    }
}

/// Whether the message of time `next` says that the one of time `held` was right: ahead, or back.
fn confirms(open: GpsTime, held: GpsTime, next: GpsTime) -> bool {
    held <= next && (held > open || next < open)
}

fn note_stray(stray: &Message, damage: &mut DamageLog) {
    damage.note_with(stray.offset, || {
        format!("a message of {} among those of another time, skipped", stray.time).into()
    });
}
