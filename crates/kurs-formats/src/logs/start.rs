//! What must be known of a log before it is read: which protocol has the observations, and the week
//! in which they begin.

use super::dating::Dating;
use super::frames::{FrameScanner, Protocol};
use super::message::{MessageKind, Role};
use crate::damage::DamageLog;
use crate::source::{ReadError, Source};
use kurs::time::GpsTime;

/// What a look into a log shows.
#[derive(Debug)]
pub(crate) struct Start {
    /// The protocol of the first message with observations (of the chosen protocol, if one is).
    pub(crate) observing: Option<Protocol>,
    /// The protocol of the first message with observations of any protocol; where there is none, of
    /// the first with observations that are not read, else of the first message.
    pub(crate) found: Option<Protocol>,
    pub(crate) dating: Dating,
}

/// Reads a log as far as it takes to know that. `chosen` is the protocol that is wanted, if one is,
/// `near` a time within ten years.
pub(crate) fn look(
    source: &mut Source,
    chosen: Option<Protocol>,
    near: Option<GpsTime>,
) -> Result<Start, ReadError> {
    let (mut scanner, mut damage) = (FrameScanner::default(), DamageLog::default());
    let mut dating = Dating::new(near);
    let [mut observing, mut read, mut unread, mut any] = [None; 4];
    loop {
        let is_known = match observing {
            Some(Protocol::Rtcm3) => dating.is_settled(),
            Some(_) => true,
            None => false,
        };
        if is_known {
            break;
        }
        let Some(frame) = scanner.next(source, &mut damage)? else { break };
        let role = MessageKind::of(&frame).role();
        any.get_or_insert(frame.protocol);
        match role {
            Role::Observations => {
                read.get_or_insert(frame.protocol);
                if chosen.is_none_or(|chosen| chosen == frame.protocol) {
                    observing.get_or_insert(frame.protocol);
                }
            }
            Role::UnreadObservations(_) => {
                unread.get_or_insert(frame.protocol);
            }
            _ => {}
        }
        dating.take(&frame);
    }
    Ok(Start { observing, found: read.or(unread).or(any), dating })
}
