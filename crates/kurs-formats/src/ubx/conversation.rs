//! What an emulated receiver answers: a host that configures one wants every CFG message
//! acknowledged, and to know whom it talks to (MON-VER). Nothing that it sets changes what is sent.

use std::collections::BTreeMap;

use super::frame;
use crate::logs::checksum::fletcher;

const ACK_NAK: [u8; 2] = [0x05, 0x00];
const ACK_ACK: [u8; 2] = [0x05, 0x01];
const CFG: u8 = 0x06;
const CFG_PRT: [u8; 2] = [CFG, 0x00];
const CFG_VALSET: [u8; 2] = [CFG, 0x8a];
const CFG_VALGET: [u8; 2] = [CFG, 0x8b];
const MON_VER: [u8; 2] = [0x0a, 0x04];

const SYNC: [u8; 2] = [0xb5, 0x62];
/// Sync, class, number, length; and the checksum behind the payload.
const HEADER: usize = 6;
const CHECKSUM: usize = 2;
/// No message of a host to a receiver is longer: CFG-VALSET has 64 values of 12 bytes at most.
const MAX_PAYLOAD: usize = 1024;
/// Values that are kept for CFG-VALGET.
const MAX_VALUES: usize = 1024;

/// One host on one connection.
#[derive(Debug, Clone)]
pub struct Conversation {
    baud: u32,
    unread: Vec<u8>,
    /// What the host has set, by key.
    values: BTreeMap<u32, Vec<u8>>,
}

impl Conversation {
    /// With a host on a line of this rate, bits a second.
    #[must_use]
    pub fn new(baud: u32) -> Self {
        Self { baud, unread: Vec::new(), values: BTreeMap::new() }
    }

    /// Takes in what the host sent, in pieces of any size, and gives what a receiver answers.
    pub fn answer(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.unread.extend_from_slice(bytes);
        let mut answers = Vec::new();
        let mut begin = 0;
        while let Some(rest) = self.unread.get(begin..)
            && !rest.is_empty()
        {
            match next(rest) {
                Next::Message { id, payload, length } => {
                    let payload = payload.to_vec();
                    begin += length;
                    answers.extend(self.answer_to(id, &payload));
                }
                Next::Noise => begin += 1,
                Next::Incomplete => break,
            }
        }
        self.unread.drain(..begin);
        answers
    }

    fn answer_to(&mut self, id: [u8; 2], payload: &[u8]) -> Vec<u8> {
        match (id, payload) {
            (MON_VER, []) => frame(MON_VER, &version()),
            (CFG_PRT, [] | [_]) => self.port(payload.first().copied()),
            (CFG_VALGET, _) => self.values(payload),
            (CFG_VALSET, _) if !self.set(payload) => frame(ACK_NAK, &id),
            // A poll of settings that are not there.
            ([CFG, _], []) => frame(ACK_NAK, &id),
            ([CFG, _], _) => frame(ACK_ACK, &id),
            _ => Vec::new(),
        }
    }

    /// The settings of a port, and that they were asked for.
    fn port(&self, number: Option<u8>) -> Vec<u8> {
        const UART_1: u8 = 1;
        /// 8 bits, no parity, one stop bit.
        const MODE: u32 = 0x08d0;
        /// UBX alone, in and out.
        const PROTOCOLS: u16 = 1;
        let mut payload = vec![number.unwrap_or(UART_1), 0, 0, 0];
        payload.extend(MODE.to_le_bytes());
        payload.extend(self.baud.to_le_bytes());
        payload.extend([PROTOCOLS.to_le_bytes(); 2].as_flattened());
        payload.extend([0; 4]);
        [frame(CFG_PRT, &payload), frame(ACK_ACK, &CFG_PRT)].concat()
    }

    /// Keeps the values; whether they are well formed.
    fn set(&mut self, payload: &[u8]) -> bool {
        // Version, layers, two reserved bytes.
        let Some(mut rest) = payload.get(4..) else { return false };
        while let Some((key, behind)) = rest.split_first_chunk() {
            let key = u32::from_le_bytes(*key);
            let Some((value, behind)) = behind.split_at_checked(value_length(key)) else {
                return false;
            };
            if self.values.len() < MAX_VALUES || self.values.contains_key(&key) {
                self.values.insert(key, value.to_vec());
            }
            rest = behind;
        }
        rest.is_empty()
    }

    /// What the host set before; a receiver refuses to answer if it does not know one of the keys.
    fn values(&self, payload: &[u8]) -> Vec<u8> {
        let keys = payload.get(4..).unwrap_or_default();
        let found: Option<Vec<u8>> = keys
            .as_chunks()
            .0
            .iter()
            .map(|key| Some([key, self.values.get(&u32::from_le_bytes(*key))?.as_slice()].concat()))
            .collect::<Option<Vec<_>>>()
            .map(|values| values.concat());
        match found {
            Some(values) if !values.is_empty() => {
                // Version of an answer, layer, position.
                let payload = [&[1, 0, 0, 0], values.as_slice()].concat();
                [frame(CFG_VALGET, &payload), frame(ACK_ACK, &CFG_VALGET)].concat()
            }
            _ => frame(ACK_NAK, &CFG_VALGET),
        }
    }
}

/// What the bytes begin with.
enum Next<'a> {
    Message { id: [u8; 2], payload: &'a [u8], length: usize },
    Noise,
    Incomplete,
}

fn next(bytes: &[u8]) -> Next<'_> {
    let begins = bytes.iter().zip(&SYNC).all(|(found, wanted)| found == wanted);
    let Some((header, _)) = bytes.split_first_chunk::<HEADER>() else {
        return if begins { Next::Incomplete } else { Next::Noise };
    };
    let payload_length = usize::from(u16::from_le_bytes([header[4], header[5]]));
    if !begins || payload_length > MAX_PAYLOAD {
        return Next::Noise;
    }
    let length = HEADER + payload_length + CHECKSUM;
    let Some(message) = bytes.get(..length) else { return Next::Incomplete };
    let (checked, checksum) = message[2..].split_at(length - 2 - CHECKSUM);
    if fletcher(checked) != checksum {
        return Next::Noise;
    }
    Next::Message { id: [header[2], header[3]], payload: &checked[HEADER - 2..], length }
}

/// Bytes of the value of a key: its size stands in bits 28 to 30.
fn value_length(key: u32) -> usize {
    match key >> 28 & 7 {
        3 => 2,
        4 => 4,
        5 => 8,
        // A bit, or a byte.
        _ => 1,
    }
}

/// MON-VER: what hosts look for in it is the generation (`hwVersion`), the protocol and the module.
fn version() -> Vec<u8> {
    let text = |text: &str, length: usize| {
        let mut bytes = text.as_bytes().to_vec();
        bytes.resize(length, 0);
        bytes
    };
    let emulated = concat!("KURS ", env!("CARGO_PKG_VERSION"));
    let mut payload = [text(emulated, 30), text("00190000", 10)].concat();
    for extension in ["FWVER=HPG 1.32", "PROTVER=27.31", "MOD=ZED-F9P", "GPS;GLO;GAL;BDS"] {
        payload.extend(text(extension, 30));
    }
    payload
}

#[cfg(test)]
mod tests {
    use super::*;

    /// CFG-VALSET of PX4 (two values), MON-VER, in pieces of every size, with noise before and
    /// between.
    #[test]
    fn pieces_of_any_size_have_one_answer_each() {
        let valset = [0, 1, 0, 0, 0x01, 0, 0x73, 0x10, 1, 0x01, 0, 0x52, 0x40, 0, 0xc2, 1, 0];
        let sent = [
            b"$GPGGA*00\r\n\xb5".to_vec(),
            frame(CFG_VALSET, &valset),
            vec![0xb5, 0x62, 0x06, 0x8a, 0xff, 0xff],
            frame(MON_VER, &[]),
            frame(CFG_VALGET, &[0, 0, 0, 0, 0x01, 0, 0x52, 0x40]),
        ]
        .concat();
        let wanted = [
            frame(ACK_ACK, &CFG_VALSET),
            frame(MON_VER, &version()),
            frame(CFG_VALGET, &[1, 0, 0, 0, 0x01, 0, 0x52, 0x40, 0, 0xc2, 1, 0]),
            frame(ACK_ACK, &CFG_VALGET),
        ]
        .concat();
        for size in 1..=sent.len() {
            let mut conversation = Conversation::new(115_200);
            let answers: Vec<u8> =
                sent.chunks(size).flat_map(|piece| conversation.answer(piece)).collect();
            assert_eq!(answers, wanted, "pieces of {size}");
        }
    }

    proptest::proptest! {
        /// Messages with any payload, and bytes of any kind between them.
        #[test]
        fn anything_is_survived(
            parts in proptest::collection::vec(
                (0..=255u8, proptest::collection::vec(0..=255u8, 0..80), 0..=255u8),
                0..40,
            ),
        ) {
            let mut conversation = Conversation::new(115_200);
            for (number, payload, noise) in parts {
                let mut sent = frame([CFG, number], &payload);
                sent.push(noise);
                conversation.answer(&sent);
                proptest::prop_assert!(conversation.unread.len() <= HEADER + MAX_PAYLOAD + CHECKSUM);
                proptest::prop_assert!(conversation.values.len() <= MAX_VALUES);
            }
        }
    }

    #[test]
    fn what_is_not_known_is_refused_and_nothing_gathers() {
        let mut conversation = Conversation::new(9600);
        let nak = |id: [u8; 2]| frame(ACK_NAK, &id);
        assert_eq!(conversation.answer(&frame(CFG_VALGET, &[0; 8])), nak(CFG_VALGET));
        assert_eq!(conversation.answer(&frame([CFG, 0x24], &[])), nak([CFG, 0x24]));
        let cut_off = [0, 1, 0, 0, 0x01, 0, 0x52, 0x40, 0, 0xc2];
        assert_eq!(conversation.answer(&frame(CFG_VALSET, &cut_off)), nak(CFG_VALSET));
        let port = conversation.answer(&frame(CFG_PRT, &[]));
        assert_eq!(u32::from_le_bytes(port[14..18].try_into().unwrap()), 9600);
        // A checksum that is wrong, and a message that never ends.
        assert!(conversation.answer(&[0xb5, 0x62, 0x0a, 0x04, 0, 0, 0, 0]).is_empty());
        for _ in 0..1000 {
            assert!(conversation.answer(&[0xb5, 0x62, 0x06, 0x8a, 0xff, 0x03]).is_empty());
        }
        assert!(conversation.unread.len() <= HEADER + MAX_PAYLOAD + CHECKSUM);
    }
}
