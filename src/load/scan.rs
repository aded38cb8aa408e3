//! A flat look over XML text before it is parsed: how deep it nests and how many attributes its elements have.
//!
//! A reader that recurses would exhaust the stack on thousands of nested elements, and the parser's time grows with the square of
//! the number of attributes. This neither recurses nor looks back.

/// The element that is over a limit.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Excess {
    /// Byte offset of the element.
    pub offset: usize,
    /// What there is too much of.
    pub what: &'static str,
    pub limit: usize,
}

/// The first element that lies deeper than `max_depth` or has more than `max_attributes`. Text that is not well-formed may pass;
/// the parser finds it.
pub(super) fn excess(text: &str, max_depth: usize, max_attributes: usize) -> Option<Excess> {
    let bytes = text.as_bytes();
    let (mut at, mut depth) = (0, 0_usize);
    while let Some(start) = find(bytes, at, b"<") {
        let rest = &bytes[start..];
        let special = [(&b"<!--"[..], &b"-->"[..]), (b"<![CDATA[", b"]]>"), (b"<?", b"?>"), (b"<!", b">")];
        if let Some((open, close)) = special.iter().find(|(open, _)| rest.starts_with(open)) {
            at = find(bytes, start + open.len(), close)? + close.len();
            continue;
        }
        let (end, attributes) = tag_end(bytes, start)?;
        if attributes > max_attributes {
            return Some(Excess { offset: start, what: "attributes of one element", limit: max_attributes });
        }
        if rest.starts_with(b"</") {
            depth = depth.saturating_sub(1);
        } else if bytes[end - 1] != b'/' {
            depth += 1;
            if depth > max_depth {
                return Some(Excess { offset: start, what: "depth of nested elements", limit: max_depth });
            }
        }
        at = end + 1;
    }
    None
}

fn find(bytes: &[u8], from: usize, what: &[u8]) -> Option<usize> {
    let first = what[0];
    let mut at = from;
    loop {
        at += bytes.get(at..)?.iter().position(|b| *b == first)?;
        if bytes[at..].starts_with(what) {
            return Some(at);
        }
        at += 1;
    }
}

/// Position of the `>` that closes the tag at `start`, quoted attribute values aside, and the number of those.
fn tag_end(bytes: &[u8], start: usize) -> Option<(usize, usize)> {
    let (mut quote, mut quoted) = (None, 0);
    for (i, &b) in bytes.iter().enumerate().skip(start + 1) {
        match (quote, b) {
            (None, b'>') => return Some((i, quoted)),
            (None, b'"' | b'\'') => quote = Some(b),
            (Some(q), _) if q == b => {
                quote = None;
                quoted += 1;
            }
            _ => {}
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_counts_open_elements_only() {
        let text = "<?xml version='1.0'?><!-- <a><a><a> --><a x='>/'><b/><b/><c><![CDATA[<d><d>]]></c></a>";
        let depth = |limit| excess(text, limit, 9).map(|e| e.offset);
        assert_eq!(depth(2), None);
        assert_eq!(depth(1), text.find("<c>"));
        for broken in ["<a><a", "< < <", "<", "<a x='", "<!--", ""] {
            assert_eq!(excess(broken, 9, 9), None, "{broken}");
        }
    }

    #[test]
    fn attributes_are_counted_by_element() {
        let text = "<a x='1' y=\"'2'\"><b x='1' y='2' z='3'/></a>";
        assert_eq!(excess(text, 9, 3), None);
        assert_eq!(
            excess(text, 9, 2).map(|e| (e.offset, e.what)),
            Some((text.find("<b").unwrap_or(0), "attributes of one element"))
        );
    }
}
