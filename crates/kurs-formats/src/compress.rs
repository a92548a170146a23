//! Files of Unix `compress` (`.Z`): Lempel-Ziv-Welch with codes of 9 to 16 bits.
//!
//! Source: T. A. Welch, A Technique for High-Performance Data Compression, IEEE Computer 17 (1984)
//! 8-19, for the method; the manual page and the behaviour of `compress` for its frame: two magic
//! bytes, a byte with the greatest width and whether code 256 clears the table, then codes, the
//! least significant bit first, in groups of eight codes of the same width.

use std::io::{self, BufReader, Read};

/// The first bytes of a file.
pub(crate) const MAGIC: [u8; 2] = [0x1f, 0x9d];
/// Width of the first codes; the greatest there is.
const MIN_WIDTH: u32 = 9;
const MAX_WIDTH: u32 = 16;
/// Codes in a group, all of one width: the rest of a group is skipped where the width changes.
const GROUP: u32 = 8;
/// Bits of the third byte.
const WIDTH_BITS: u8 = 0x1f;
const BLOCK_MODE: u8 = 0x80;
/// In block mode this code empties the table.
const CLEAR: u16 = 256;

/// Unpacks a file.
pub(crate) struct Decoder<R> {
    input: BufReader<R>,
    max_width: u32,
    block_mode: bool,
    /// The entry of each code from 256 on: the entry before its last byte, and that byte.
    table: Vec<(u16, u8)>,
    width: u32,
    /// Codes read in the current group.
    in_group: u32,
    bits: u32,
    bit_count: u32,
    last: Option<(u16, u8)>,
    /// Unpacked bytes in reverse order.
    ready: Vec<u8>,
    at_end: bool,
}

impl<R: Read> Decoder<R> {
    /// Takes over at the start of the file.
    pub(crate) fn new(input: R) -> io::Result<Self> {
        let mut input = BufReader::new(input);
        let mut header = [0; 3];
        input.read_exact(&mut header)?;
        let [_, _, flags] = header;
        let max_width = u32::from(flags & WIDTH_BITS);
        if !(MIN_WIDTH..=MAX_WIDTH).contains(&max_width) {
            return Err(damaged("codes of a width that compress does not have"));
        }
        Ok(Self {
            input,
            max_width,
            block_mode: flags & BLOCK_MODE != 0,
            table: Vec::new(),
            width: MIN_WIDTH,
            in_group: 0,
            bits: 0,
            bit_count: 0,
            last: None,
            ready: Vec::new(),
            at_end: false,
        })
    }

    /// The first code that has no entry yet.
    fn next_free(&self) -> u32 {
        256 + u32::from(self.block_mode) + u32::try_from(self.table.len()).unwrap_or(u32::MAX)
    }

    /// The next code; `None` at the end.
    fn code(&mut self) -> io::Result<Option<u16>> {
        while self.bit_count < self.width {
            let mut byte = [0];
            if self.input.read(&mut byte)? == 0 {
                return Ok(None);
            }
            self.bits |= u32::from(byte[0]) << self.bit_count;
            self.bit_count += 8;
        }
        #[allow(clippy::cast_possible_truncation)] // at most 16 bits
        let code = (self.bits & ((1 << self.width) - 1)) as u16;
        self.bits >>= self.width;
        self.bit_count -= self.width;
        self.in_group = (self.in_group + 1) % GROUP;
        Ok(Some(code))
    }

    /// Codes are of another width from here on.
    fn set_width(&mut self, width: u32) -> io::Result<()> {
        while self.in_group != 0 && self.code()?.is_some() {}
        (self.width, self.in_group, self.bits, self.bit_count) = (width, 0, 0, 0);
        Ok(())
    }

    /// Unpacks the next code into `ready`.
    fn unpack(&mut self) -> io::Result<()> {
        if self.next_free() >= 1 << self.width && self.width < self.max_width {
            self.set_width(self.width + 1)?;
        }
        let Some(code) = self.code()? else {
            self.at_end = true;
            return Ok(());
        };
        if code == CLEAR && self.block_mode {
            self.table.clear();
            self.last = None;
            return self.set_width(MIN_WIDTH);
        }
        let Some((last, last_first)) = self.last else {
            let byte = u8::try_from(code).map_err(|_| damaged("the first code is none"))?;
            self.ready.push(byte);
            self.last = Some((code, byte));
            return Ok(());
        };
        let free = self.next_free();
        let mut entry = match u32::from(code) {
            known if known < free => code,
            // The entry that is about to be made: the last one and its own first byte.
            same if same == free => {
                self.ready.push(last_first);
                last
            }
            _ => return Err(damaged("a code that has no entry yet")),
        };
        while let Some(index) = usize::from(entry).checked_sub(256 + usize::from(self.block_mode)) {
            let (before, byte) = self.table[index];
            self.ready.push(byte);
            entry = before;
        }
        let first =
            u8::try_from(entry).map_err(|_| damaged("an entry that begins with no byte"))?;
        self.ready.push(first);
        if free < 1 << self.max_width {
            self.table.push((last, first));
        }
        self.last = Some((code, first));
        Ok(())
    }
}

impl<R: Read> Read for Decoder<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let mut count = 0;
        while count < out.len() {
            match self.ready.pop() {
                Some(byte) => {
                    out[count] = byte;
                    count += 1;
                }
                None if self.at_end => break,
                // What was unpacked before the damage is good.
                None => match self.unpack() {
                    Err(_) if count > 0 => break,
                    unpacked => unpacked?,
                },
            }
        }
        Ok(count)
    }
}

fn damaged(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashMap;

    /// Writes codes as `compress` does.
    struct Packer {
        out: Vec<u8>,
        group: Vec<u32>,
        width: u32,
    }

    impl Packer {
        fn emit(&mut self, code: u32) {
            self.group.push(code);
            if self.group.len() == GROUP as usize {
                self.flush();
            }
        }

        /// The reader has one entry less than it has seen codes since the table was empty.
        fn widen(&mut self, count: u32, max_width: u32) {
            let free = 257 + count.saturating_sub(1);
            if free >= 1 << self.width && self.width < max_width {
                self.set_width(self.width + 1);
            }
        }

        fn set_width(&mut self, width: u32) {
            let rest = GROUP as usize - self.group.len();
            (0..rest % GROUP as usize).for_each(|_| self.emit(0));
            self.width = width;
        }

        fn flush(&mut self) {
            let (group, width) = (core::mem::take(&mut self.group), self.width);
            let bits = group.iter().flat_map(|code| (0..width).map(move |i| code >> i & 1 == 1));
            let byte = |bits: &[bool]| {
                bits.iter().enumerate().fold(0, |sum, (i, bit)| sum | u8::from(*bit) << i)
            };
            self.out.extend(bits.collect::<Vec<bool>>().chunks(8).map(byte));
        }
    }

    /// Packs as `compress -b` does, with a clearing code behind every `clear_after` others.
    fn packed(bytes: &[u8], max_width: u32, clear_after: u32) -> Vec<u8> {
        let flags = u8::try_from(max_width).unwrap() | BLOCK_MODE;
        let out = vec![MAGIC[0], MAGIC[1], flags];
        let mut packer = Packer { out, group: Vec::new(), width: MIN_WIDTH };
        let mut table: HashMap<Vec<u8>, u32> = HashMap::new();
        let (mut rest, mut count) = (bytes, 0u32);
        while !rest.is_empty() {
            let known = |length: &usize| *length == 1 || table.contains_key(&rest[..*length]);
            let length = (1..=rest.len()).take_while(known).last().unwrap();
            let (text, behind) = rest.split_at(length);
            packer.widen(count, max_width);
            packer.emit(if length == 1 { text[0].into() } else { table[text] });
            if 257 + count < 1 << max_width && !behind.is_empty() {
                table.insert(rest[..=length].to_vec(), 257 + count);
            }
            (rest, count) = (behind, count + 1);
            if count == clear_after {
                packer.widen(count, max_width);
                packer.emit(CLEAR.into());
                packer.set_width(MIN_WIDTH);
                table.clear();
                count = 0;
            }
        }
        packer.flush();
        packer.out
    }

    fn unpacked(file: &[u8]) -> io::Result<Vec<u8>> {
        let mut read = Vec::new();
        Decoder::new(file)?.read_to_end(&mut read)?;
        Ok(read)
    }

    /// Written by `compress` 4.2.4: "aaaa" has an entry that is used while it is made.
    #[test]
    fn a_file_of_compress() {
        let file = [0x1f, 0x9d, 0x90, b'a', 0x02, 0x86, 0x01];
        assert_eq!(unpacked(&file).unwrap(), b"aaaa");
    }

    #[test]
    fn damage_is_an_error() {
        assert!(unpacked(&[0x1f, 0x9d]).is_err());
        assert!(unpacked(&[0x1f, 0x9d, 0x85, 1, 2, 3]).is_err(), "codes of 5 bits");
        assert!(unpacked(&[0x1f, 0x9d, 0x90, 0xff, 0xff, 0xff]).is_err(), "a code that is none");
    }

    proptest! {
        #[test]
        fn what_is_packed_is_unpacked(
            bytes in proptest::collection::vec(0u8..3, 0..6000),
            max_width in 9u32..=16,
            clear_after in 1u32..2000,
        ) {
            prop_assert_eq!(unpacked(&packed(&bytes, max_width, clear_after)).unwrap(), bytes);
        }
    }
}
