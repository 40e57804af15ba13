//! How messages show numbers, and what users wrote: short, and on one line.

use std::fmt;

/// A number with every digit that tells it from its neighbours, and with an exponent where
/// it would have many zeros instead.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shortest(pub(crate) f64);

impl fmt::Display for Shortest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(number) = *self;
        let plain = number == 0.0 || (1e-3..1e6).contains(&number.abs());
        if plain || !number.is_finite() {
            write!(f, "{number}")
        } else {
            write!(f, "{number:e}")
        }
    }
}

/// A computed number, to four digits.
pub(crate) fn four_digits(number: f64) -> Shortest {
    // By way of text, so that no digit is left over.
    Shortest(format!("{number:.3e}").parse().unwrap_or(number))
}

/// A computed number, to three digits, as pages and tables show it and other programs read it.
#[cfg(any(feature = "cli", feature = "report", test))]
pub(crate) fn three_digits(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    if !value.is_finite() {
        return "not finite".into();
    }
    let magnitude = libm::floor(libm::log10(value.abs()));
    if (-3.0..5.0).contains(&magnitude) {
        format!("{value:.*}", (2.0 - magnitude).clamp(0.0, 6.0) as usize)
    } else {
        format!("{value:.2e}")
    }
}

/// A computed number, to four digits and rounded away from zero, so that a printed bound is
/// never too small.
#[cfg(any(feature = "cli", test))]
pub(crate) fn round_away_from_zero(number: f64) -> Shortest {
    let Shortest(rounded) = four_digits(number);
    if rounded.abs() < number.abs() {
        four_digits(rounded * (1.0 + 1e-3))
    } else {
        Shortest(rounded)
    }
}

/// `text` on one line and of at most `most` characters.
pub(crate) fn one_line(text: &str, most: usize) -> String {
    let mut line = String::new();
    for word in text.split_whitespace() {
        if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
    }
    if line.chars().count() > most {
        let kept = line.chars().take(most).collect::<String>();
        return format!("{kept}...");
    }
    line
}

/// A word as a shell takes it.
#[cfg(any(feature = "campaign", test))]
pub(crate) fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "/._-+=:,@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn numbers_have_an_exponent_instead_of_many_zeros() {
        for (number, text) in [
            (0.0, "0"),
            (-0.5, "-0.5"),
            (0.001, "0.001"),
            (100_000.0, "100000"),
            (1e6, "1e6"),
            (-1e300, "-1e300"),
            (5e-324, "5e-324"),
            (f64::NAN, "NaN"),
            (f64::NEG_INFINITY, "-inf"),
        ] {
            assert_eq!(Shortest(number).to_string(), text);
        }
        assert_eq!(four_digits(10.961_42).to_string(), "10.96");
        assert_eq!(round_away_from_zero(10.961_42).to_string(), "10.97");
        assert_eq!(round_away_from_zero(9.999_9).to_string(), "10");
    }

    #[test]
    fn words_are_quoted_where_a_shell_would_take_them_apart() {
        assert_eq!(quoted("out/a-b_1.toml"), "out/a-b_1.toml");
        assert_eq!(quoted("a b'; rm -r \"c\""), r#"'a b'\''; rm -r "c"'"#);
        assert_eq!(quoted(""), "''");
    }

    #[test]
    fn numbers_have_three_digits() {
        let texts = [0.0, 1.2345, -0.012345, 123.45, 1.5e-5, 1e9, f64::NAN].map(three_digits);
        let wanted = [
            "0",
            "1.23",
            "-0.0123",
            "123",
            "1.50e-5",
            "1.00e9",
            "not finite",
        ];
        assert_eq!(texts, wanted);
    }

    #[test]
    fn what_users_wrote_comes_on_one_line() {
        assert_eq!(one_line(" [1,\n  2 ]", 40), "[1, 2 ]");
        assert_eq!(one_line("\u{e9}\u{e9}\u{e9}", 2), "\u{e9}\u{e9}...");
    }

    proptest! {
        #[test]
        fn numbers_are_short_and_come_back(number: f64) {
            let text = Shortest(number).to_string();
            prop_assert!(text.len() <= 24, "{text}");
            prop_assert!(number.is_nan() || text.parse::<f64>() == Ok(number));
        }

        #[test]
        fn enough_is_enough_and_not_much_more(number in -1e9..1e9_f64) {
            let Shortest(rounded) = round_away_from_zero(number);
            prop_assert!(rounded.abs() >= number.abs());
            prop_assert!(rounded.abs() <= 1.0021 * number.abs());
        }
    }
}
