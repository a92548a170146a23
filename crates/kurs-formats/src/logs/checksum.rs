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
    let crc = bytes.iter().fold(0u32, |crc, byte| {
        let [_, high, ..] = crc.to_be_bytes();
        (crc << 8) & 0xff_ffff ^ CRC24Q[usize::from(high ^ byte)]
    });
    let [_, high, middle, low] = crc.to_be_bytes();
    [high, middle, low]
}

/// CRC-16 of Septentrio blocks, polynomial 1021₁₆, most significant bit first, beginning with zero.
pub(crate) fn crc16_ccitt(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0u16, |crc, byte| {
        let [high, _] = crc.to_be_bytes();
        (crc << 8) ^ CRC16[usize::from(high ^ byte)]
    })
}

const CRC24Q: [u32; 256] = {
    let mut table = [0u32; 256];
    let mut byte = 0u32;
    while byte < 256 {
        let mut crc = byte << 16;
        let mut bit = 0;
        while bit < 8 {
            crc <<= 1;
            if crc & 0x100_0000 != 0 {
                crc ^= 0x186_4cfb;
            }
            bit += 1;
        }
        table[byte as usize] = crc;
        byte += 1;
    }
    table
};

const CRC16: [u16; 256] = {
    let mut table = [0u16; 256];
    let mut byte = 0u16;
    while byte < 256 {
        let mut crc = byte << 8;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 0x8000 != 0 { (crc << 1) ^ 0x1021 } else { crc << 1 };
            bit += 1;
        }
        table[byte as usize] = crc;
        byte += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::*;

    /// Check values of the string "123456789" (catalogue of parametrised CRC algorithms: CRC-24/LTE-A
    /// with this polynomial and zero start, CRC-16/XMODEM).
    #[test]
    fn check_values() {
        assert_eq!(crc24q(b"123456789"), [0xcd, 0xe7, 0x03]);
        assert_eq!(crc16_ccitt(b"123456789"), 0x31c3);
    }
}
