//! Which light paths count: a regular expression over their letters [Heckbert90].

use regex::{Regex, RegexBuilder};

/// Letters of a path from the lamp to the eye.
const LETTERS: [char; 5] = ['L', 'S', 'M', 'D', 'E'];
/// Most bytes of a compiled expression.
const MOST_BYTES: usize = 1 << 20;

/// A set of light paths, as words over L (lamp), D (a surface that scatters: diffuse or rough), S (one that does not: ideal mirror or
/// glass), M (of these, a flat mirror) and E (eye). What light goes straight through (masks, plates) has no letter.
#[derive(Debug, Clone)]
pub struct PathFilter {
    text: String,
    whole: Regex,
}

impl PathFilter {
    /// Reads an expression, such as `LS+DE`.
    ///
    /// # Errors
    /// A sentence for the user.
    pub fn new(text: &str) -> Result<Self, String> {
        if let Some(letter) = text.chars().find(|c| c.is_alphanumeric() && !LETTERS.contains(c) && !c.is_ascii_digit()) {
            return Err(format!(
                "\"{letter}\" is no letter of a light path; expected L, S, M, D, E and signs such as * + ? | ( )"
            ));
        }
        // Every flat mirror is an S as well; classes within classes are unions.
        let letters = text.replace('S', "[SM]");
        let built = RegexBuilder::new(&format!("^(?:{letters})$")).size_limit(MOST_BYTES).build();
        // An expression may be right only with what was put around it.
        let alone = RegexBuilder::new(text).size_limit(MOST_BYTES).build();
        match (built, alone) {
            (Ok(whole), Ok(_)) => Ok(Self { text: text.to_owned(), whole }),
            (Err(error), _) | (_, Err(error)) => {
                let line = error.to_string().lines().last().unwrap_or_default().to_owned();
                Err(format!("expected a regular expression over light paths, such as LS+DE; {line}"))
            }
        }
    }

    /// The letter of an ideal surface.
    pub fn ideal(is_flat_mirror: bool) -> u8 {
        if is_flat_mirror { b'M' } else { b'S' }
    }

    /// As it was typed.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// True if a path counts whose surfaces have the letters `word`, from the eye to the lamp.
    pub fn has(&self, word: &[u8]) -> bool {
        let letters = word.iter().rev().map(|b| char::from(*b));
        let whole: String = std::iter::once('L').chain(letters).chain(std::iter::once('E')).collect();
        self.whole.is_match(&whole)
    }
}

impl PartialEq for PathFilter {
    fn eq(&self, other: &Self) -> bool {
        self.text == other.text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_read_from_the_lamp() {
        let filter = PathFilter::new("LS+DE").expect("well formed");
        assert!(filter.has(b"DS") && filter.has(b"DSS"));
        assert!(!filter.has(b"SD") && !filter.has(b"D") && !filter.has(b"DSD"));
        assert!(PathFilter::new("L(S|D)*E").expect("well formed").has(b""));
        let reversed = PathFilter::new("LDSE").expect("well formed");
        assert!(reversed.has(b"SD") && !reversed.has(b"DS"), "a mirror that the eye sees is no mirror that the lamp sees");
        assert!(!PathFilter::new("LD").expect("well formed").has(b"D"), "an expression stands for whole paths");
    }

    #[test]
    fn flat_mirrors_are_mirrors() {
        let filter = PathFilter::new("L(S|D)*E").expect("well formed");
        assert!(filter.has(b"MDS") && PathFilter::new("L[SD]*E").expect("well formed").has(b"MD"));
        let flat = PathFilter::new("LMDE").expect("well formed");
        assert!(flat.has(b"DM") && !flat.has(b"DS"), "no other mirror is flat");
        assert!(!PathFilter::new("L[^S]*E").expect("well formed").has(b"M"));
    }

    #[test]
    fn what_is_no_expression_is_refused() {
        for (bad, said) in [("L(DE", "regular expression"), ("LXE", "\"X\""), ("L*+)E", "regular expression"), ("a|b", "\"a\"")] {
            let message = PathFilter::new(bad).expect_err(bad);
            assert!(message.contains(said), "{bad}: {message}");
        }
    }
}
