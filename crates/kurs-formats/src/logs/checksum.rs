//! Checksums of the binary protocols.

/// Checksum of u-blox messages: the 8-bit Fletcher algorithm of RFC 1145.
pub(crate) fn fletcher(bytes: &[u8]) -> [u8; 2] {
    let (mut a, mut b) = (0u8, 0u8);
    for byte in bytes {
        a = a.wrapping_add(*byte);
        b = b.wrapping_add(a);
    }
    [a, b]
}

/// CRC-24Q of RTCM 3 and Galileo, polynomial 1864CFB₁₆, most significant bit first.
pub(crate) fn crc24q(bytes: &[u8]) -> [u8; 3] {
    static CRC24Q: Division = Division::by(0x86_4cfb << 8);
    let [high, middle, low, _] = CRC24Q.remainder(bytes).to_be_bytes();
    [high, middle, low]
}

/// CRC-16 of Septentrio blocks, polynomial 1021₁₆, most significant bit first, beginning with zero.
pub(crate) fn crc16_ccitt(bytes: &[u8]) -> u16 {
    static CRC16: Division = Division::by(0x1021 << 16);
    let [high, low, _, _] = CRC16.remainder(bytes).to_be_bytes();
    u16::from_be_bytes([high, low])
}

/// Division of bits by a polynomial of degree 32 or less, eight bytes at a time.
struct Division {
    /// Remainders of every byte with 0 to 7 bytes of zeros behind it.
    remainders: [[u32; 256]; 8],
}

impl Division {
    /// By a polynomial without its highest bit, at the top of the 32 bits; so stand the remainders.
    const fn by(polynomial: u32) -> Self {
        let mut remainders = [[0u32; 256]; 8];
        let mut byte = 0u32;
        while byte < 256 {
            let mut remainder = byte << 24;
            let mut bit = 0;
            while bit < 8 * remainders.len() {
                let subtracted = if remainder >> 31 == 1 { polynomial } else { 0 };
                remainder = (remainder << 1) ^ subtracted;
                bit += 1;
                if bit % 8 == 0 {
                    remainders[bit / 8 - 1][byte as usize] = remainder;
                }
            }
            byte += 1;
        }
        Self { remainders }
    }

    /// The remainder of the bytes with four bytes of zeros behind them.
    fn remainder(&self, bytes: &[u8]) -> u32 {
        let of = |zeros: usize, byte: u8| self.remainders[zeros][usize::from(byte)];
        let (eights, rest) = bytes.as_chunks();
        // The remainder so far stands under the next four bytes; that of a sum is the sum of those.
        let remainder = eights.iter().fold(0u32, |so_far, [a, b, c, d, e, f, g, h]| {
            let [p, q, r, s] = so_far.to_be_bytes();
            (of(7, a ^ p) ^ of(6, b ^ q) ^ of(5, c ^ r) ^ of(4, d ^ s))
                ^ (of(3, *e) ^ of(2, *f) ^ of(1, *g) ^ of(0, *h))
        });
        rest.iter().fold(remainder, |so_far, byte| {
            let [high, ..] = so_far.to_be_bytes();
            (so_far << 8) ^ of(0, high ^ byte)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Check values of the string "123456789" (catalogue of parametrised CRC algorithms:
    /// CRC-24/LTE-A with this polynomial and zero start, CRC-16/XMODEM).
    #[test]
    fn check_values() {
        assert_eq!(crc24q(b"123456789"), [0xcd, 0xe7, 0x03]);
        assert_eq!(crc16_ccitt(b"123456789"), 0x31c3);
    }

    /// Division bit by bit, of any length of bytes.
    #[test]
    fn eight_bytes_at_a_time_are_as_bit_by_bit() {
        let bytes: Vec<u8> = (0..100u8).map(|n| n.wrapping_mul(151).rotate_left(3)).collect();
        for length in 0..=bytes.len() {
            let bytes = &bytes[..length];
            let bits = bytes.iter().flat_map(|byte| (0..8).rev().map(move |bit| byte >> bit & 1));
            let (mut long, mut short) = (0u32, 0u16);
            for bit in bits {
                let subtracted = (long >> 23 & 1) ^ u32::from(bit);
                long = ((long << 1) ^ (subtracted * 0x86_4cfb)) & 0xff_ffff;
                let subtracted = (short >> 15) ^ u16::from(bit);
                short = (short << 1) ^ (subtracted * 0x1021);
            }
            assert_eq!(crc24q(bytes)[..], long.to_be_bytes()[1..]);
            assert_eq!(crc16_ccitt(bytes), short);
        }
    }
}
