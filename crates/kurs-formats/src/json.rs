//! Numbers and words of JSON.

/// A number with `decimals` decimals; `null` for what is not known.
pub(crate) fn number(value: Option<f64>, decimals: usize) -> String {
    let finite = value.filter(|value| value.is_finite());
    // Adding zero takes the sign from a zero.
    finite.map_or_else(|| "null".to_owned(), |value| format!("{:.decimals$}", value + 0.0))
}

/// In quotes, with what JSON does not allow between them escaped.
pub(crate) fn word(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => quoted.push_str(&format!("\\u{:04x}", u32::from(c))),
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}
