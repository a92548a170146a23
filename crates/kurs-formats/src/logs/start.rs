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
    /// The protocol of the first message with observations; where there is none, that of the first
    /// with observations that are not read, else that of the first message.
    pub(crate) protocol: Option<Protocol>,
    pub(crate) dating: Dating,
}

/// Reads a log as far as it takes to know that. `wanted` is the protocol if it is chosen, `near` a
/// time within ten years.
pub(crate) fn look(
    source: &mut Source,
    wanted: Option<Protocol>,
    near: Option<GpsTime>,
) -> Result<Start, ReadError> {
    let (mut scanner, mut damage) = (FrameScanner::default(), DamageLog::default());
    let mut dating = Dating::new(near);
    let [mut observing, mut unread, mut any] = [wanted, None, None];
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
            Role::Observations => drop(observing.get_or_insert(frame.protocol)),
            Role::UnreadObservations(_) => drop(unread.get_or_insert(frame.protocol)),
            _ => {}
        }
        dating.take(&frame);
    }
    Ok(Start { protocol: observing.or(unread).or(any), dating })
}
