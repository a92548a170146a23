//! What the words of the column `reason` mean, and what helps: for rows that no trial explains.

use super::patient::Finding;

/// A word with its meaning and advice.
struct Explained {
    word: &'static str,
    meaning: &'static str,
    advice: &'static str,
}

const EXPLAINED: [Explained; 20] = [
    Explained {
        word: "few_satellites",
        meaning: "the antennas share too few satellites",
        advice: "free the antennas' view, use every system, lower `elevation_mask_deg`",
    },
    Explained {
        word: "few_antennas",
        meaning: "fewer than two antennas have observations",
        advice: "look for a receiver that fell silent, and at the hours of the files",
    },
    Explained {
        word: "no_ephemeris",
        meaning: "satellites in view have no ephemeris",
        advice: "give navigation data of this time",
    },
    Explained {
        word: "no_phase",
        meaning: "there is no carrier phase that can be an integer",
        advice: "let the receivers log carrier phase, and wait until half cycles are resolved",
    },
    Explained {
        word: "time_mismatch",
        meaning: "the antennas are not sampled together",
        advice: "set all receivers to the same rate, aligned to GPS time",
    },
    Explained {
        word: "weak_model",
        meaning: "the observations are too weak to be sure of the integers",
        advice: "use more bands and systems, known positions, or `ambiguity = \"continuous\"`",
    },
    Explained {
        word: "success_rate",
        meaning: "the observations are too weak to be sure of the integers",
        advice: "use more bands and systems, known positions, or `ambiguity = \"continuous\"`",
    },
    Explained {
        word: "ratio",
        meaning: "other integers are almost as probable as the best",
        advice: "look for reflections; use more bands, or `ambiguity = \"continuous\"`",
    },
    Explained {
        word: "length",
        meaning: "a baseline has not the known length",
        advice: "measure `position_m` again, or take the positions of `kurs survey`",
    },
    Explained {
        word: "geometry",
        meaning: "the baselines do not fit the known array",
        advice: "measure `position_m` again, or take the positions of `kurs survey`",
    },
    Explained {
        word: "tilt",
        meaning: "the body would tilt more than `max_tilt_deg`",
        advice: "look at the signs of `position_m`, or raise `max_tilt_deg`",
    },
    Explained {
        word: "residuals",
        meaning: "the phases do not fit their integers",
        advice: "look for reflections, mixed receivers, and antennas that move against each other",
    },
    Explained {
        word: "two_minima",
        meaning: "two attitudes fit alike",
        advice: "put one antenna off the line or plane of the others",
    },
    Explained {
        word: "closure",
        meaning: "the integers of single baselines contradict each other",
        advice: "look for reflections, and at the cable of each antenna",
    },
    Explained {
        word: "budget",
        meaning: "the search for integers came to no end",
        advice: "look for reflections and wrong `position_m`; use fewer bands",
    },
    Explained {
        word: "slip",
        meaning: "too many cycle slips at once",
        advice: "look at the antennas' cables and at what shades them",
    },
    Explained {
        word: "bad_input",
        meaning: "the observations lead to no place near the Earth",
        advice: "look at the receivers with `kurs inspect`",
    },
    Explained {
        word: "unproven",
        meaning: "a weak model has integers that no other epoch confirms",
        advice: "use more bands and systems or known positions; a fix counts from its first agreement",
    },
    Explained {
        word: "contradiction",
        meaning: "integers that should not change between two epochs do",
        advice: "look for reflections, and for cycle slips that a receiver does not flag",
    },
    Explained {
        word: "predicted",
        meaning: "the antennas have no attitude, a gyro carries it on",
        advice: "solve the antennas alone to see why they have none",
    },
];

/// What the word means; the word itself where that is not known.
pub(super) fn meaning(word: &str) -> &str {
    explained(word).map_or(word, |reason| reason.meaning)
}

/// What helps; nothing where that is not known.
pub(super) fn advice(word: &str) -> &str {
    explained(word).map_or("", |reason| reason.advice)
}

/// The finding of a session of which all that is known is why most of its rows are not fixed.
pub(super) fn unexplained(word: &'static str, evidence: String) -> Finding {
    Finding {
        code: "unexplained",
        cause: meaning(word).into(),
        evidence,
        advice: advice(word).into(),
    }
}

fn explained(word: &str) -> Option<&'static Explained> {
    EXPLAINED.iter().find(|reason| reason.word == word)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::solution::Reason;

    #[test]
    fn every_reason_is_explained() {
        for reason in Reason::ALL {
            assert_ne!(meaning(reason.word()), reason.word());
        }
        assert_eq!(meaning("another"), "another");
    }
}
