//! A flat look over XML text before it is parsed: how deep it nests.
//!
//! A parser or a reader that recurses would exhaust the stack on a file that nests thousands of elements; this does not recurse.

/// Byte offset of the first element that lies deeper than `limit`. Text that is not well-formed may pass; the parser finds it.
pub(super) fn too_deep(text: &str, limit: usize) -> Option<usize> {
    let bytes = text.as_bytes();
    let (mut at, mut depth) = (0, 0_usize);
    while let Some(start) = find(bytes, at, b"<") {
        let rest = &bytes[start..];
        let special = [(&b"<!--"[..], &b"-->"[..]), (b"<![CDATA[", b"]]>"), (b"<?", b"?>"), (b"<!", b">")];
        if let Some((open, close)) = special.iter().find(|(open, _)| rest.starts_with(open)) {
            at = find(bytes, start + open.len(), close)? + close.len();
            continue;
        }
        let end = tag_end(bytes, start)?;
        if rest.starts_with(b"</") {
            depth = depth.saturating_sub(1);
        } else if bytes[end - 1] != b'/' {
            depth += 1;
            if depth > limit {
                return Some(start);
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

/// Position of the `>` that closes the tag at `start`, quoted attribute values aside.
fn tag_end(bytes: &[u8], start: usize) -> Option<usize> {
    let mut quote = None;
    for (i, &b) in bytes.iter().enumerate().skip(start + 1) {
        match (quote, b) {
            (None, b'>') => return Some(i),
            (None, b'"' | b'\'') => quote = Some(b),
            (Some(q), _) if q == b => quote = None,
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
        assert_eq!(too_deep(text, 2), None);
        assert_eq!(too_deep(text, 1), text.find("<c>"));
        assert_eq!(too_deep("<a><a", 9), None);
        assert_eq!(too_deep("< < <", 9), None);
        assert_eq!(too_deep("<", 0), None);
    }
}
