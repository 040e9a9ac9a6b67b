//! How pages, comments and messages are written: words in a sentence, words that have a better one, long
//! lines.
//!
//! Markdown pages have sentences. Of sources, comments and long strings are searched for words only: a
//! comment is often no sentence.

use std::path::Path;
use std::process::Command;

use crate::workspace::root;

/// Sequences of words, each with its alternatives, and what to write instead.
const BANNED: &str = include_str!("banned_words.txt");

/// Pages whose lines are those of the code that writes them.
const GENERATED: [&str; 2] = [
    "docs/reference/effects.md",
    "lab/library/src/effect_reference.md",
];

/// Mean words in a sentence of all pages and of each, words in the longest sentence.
const MOST_MEAN_WORDS: f64 = 17.0;
const MOST_MEAN_WORDS_OF_PAGE: f64 = 20.0;
const MOST_WORDS: usize = 45;
/// Columns of a line.
const MOST_COLUMNS: usize = 110;
/// Shorter strings are names and keys.
const LEAST_MESSAGE_CHARACTERS: usize = 25;

/// What one file has.
#[derive(Default)]
struct Figures {
    sentences: usize,
    words: usize,
    longest: usize,
    long_sentences: Vec<(usize, usize)>,
    banned: Vec<(usize, &'static str, &'static str)>,
    long_lines: Vec<(usize, usize)>,
}

impl Figures {
    fn mean(&self) -> f64 {
        if self.sentences == 0 {
            0.0
        } else {
            self.words as f64 / self.sentences as f64
        }
    }
}

/// Words in their order, lower case, parted at hyphens as well.
fn words(text: &str) -> Vec<String> {
    text.split(|c: char| !(c.is_alphanumeric() || c == '\'' || c == '’'))
        .map(|word| word.trim_matches('\'').replace('’', "'").to_lowercase())
        .filter(|word| !word.is_empty())
        .collect()
}

/// How many words a sentence has: a hyphen joins, code in backticks is one word, the target of a link does
/// not count.
fn number_of_words(sentence: &str) -> usize {
    let (mut plain, mut in_code) = (String::new(), false);
    for part in sentence.split('`') {
        plain.push_str(if in_code { "code" } else { part });
        in_code = !in_code;
    }
    let mut rest = plain.as_str();
    let mut text = String::new();
    while let Some((before, after)) = rest.split_once("](") {
        text.push_str(before);
        text.push(' ');
        rest = after.split_once(')').map_or("", |(_, after)| after);
    }
    text.push_str(rest);
    let joins =
        |c: char| c.is_alphanumeric() || matches!(c, '\'' | '’' | '-' | '_' | '.' | ',' | '/');
    text.split(|c: char| !joins(c))
        .filter(|word| word.chars().any(char::is_alphanumeric))
        .count()
}

/// Sentences of a paragraph with the byte at which each begins. A colon or a semicolon ends one as a full
/// stop does.
fn sentences(paragraph: &str) -> Vec<(usize, &str)> {
    let (mut found, mut begin, mut in_code) = (Vec::new(), 0, false);
    let mut characters = paragraph.char_indices().peekable();
    while let Some((at, c)) = characters.next() {
        in_code ^= c == '`';
        if in_code || !matches!(c, '.' | '!' | '?' | ':' | ';') {
            continue;
        }
        // Brackets and emphasis close behind the stop.
        let after = paragraph[at + c.len_utf8()..].trim_start_matches(['*', '"', ')', '”']);
        let next = after.trim_start();
        let starts_anew = !next.starts_with(char::is_lowercase) || c != '.';
        if after.starts_with(char::is_whitespace) && starts_anew {
            let end = paragraph.len() - after.len();
            found.push((begin, &paragraph[begin..end]));
            begin = paragraph.len() - next.len();
            while characters.peek().is_some_and(|(at, _)| *at < begin) {
                characters.next();
            }
        }
    }
    found.push((begin, &paragraph[begin..]));
    found
}

/// Looks for words that have a better one.
fn banned(text: &str) -> Vec<(&'static str, &'static str)> {
    let words = words(text);
    let stands = |sequence: &str| {
        let sequence: Vec<Vec<&str>> = sequence
            .split_whitespace()
            .map(|word| word.split('|').collect())
            .collect();
        words.windows(sequence.len()).any(|window| {
            window
                .iter()
                .zip(&sequence)
                .all(|(word, any)| any.contains(&word.as_str()))
        })
    };
    BANNED
        .lines()
        .filter_map(|line| line.split_once(" = "))
        .filter(|(sequence, _)| stands(sequence))
        .collect()
}

/// Paragraphs of a page without code, tables, headings and what a program writes between marks: lines with
/// their numbers.
fn paragraphs(page: &str) -> Vec<Vec<(usize, &str)>> {
    let (mut all, mut current, mut in_code, mut in_list) = (Vec::new(), Vec::new(), false, false);
    let mut is_generated = false;
    for (number, line) in page.lines().enumerate() {
        let text = line.trim_start();
        if text.starts_with("<!--") {
            is_generated = text.contains(": written ");
        }
        let is_item = ["- ", "* "].iter().any(|mark| text.starts_with(mark))
            || text.split_once(". ").is_some_and(|(number, _)| {
                !number.is_empty() && number.chars().all(|c| c.is_ascii_digit())
            });
        in_code ^= text.starts_with("```");
        let is_indented = line.starts_with("    ") && !in_list && current.is_empty();
        let is_other = in_code
            || is_generated
            || is_indented
            || text.starts_with(['|', '#', '<'])
            || text.starts_with("```")
            || text.starts_with("![");
        if text.is_empty() || is_other || is_item {
            if !current.is_empty() {
                all.push(std::mem::take(&mut current));
            }
            in_list = is_item || (in_list && (text.is_empty() || line.starts_with(' ')));
        }
        if !text.is_empty() && !is_other {
            current.push((number + 1, text));
        }
    }
    if !current.is_empty() {
        all.push(current);
    }
    all
}

/// A page in Markdown.
fn page(text: &str) -> Figures {
    let mut figures = Figures::default();
    for paragraph in paragraphs(text) {
        for (number, line) in &paragraph {
            if line.chars().count() > MOST_COLUMNS {
                figures.long_lines.push((*number, line.chars().count()));
            }
        }
        let joined = paragraph
            .iter()
            .map(|(_, line)| *line)
            .collect::<Vec<_>>()
            .join(" ");
        for (begin, sentence) in sentences(&joined) {
            let mut passed = 0;
            let starts_later = |(_, line): &&(usize, &str)| {
                passed += line.len() + 1;
                passed > begin
            };
            let number = paragraph
                .iter()
                .find(starts_later)
                .map_or(0, |(number, _)| *number);
            let count = number_of_words(sentence);
            if count == 0 {
                continue;
            }
            figures.sentences += 1;
            figures.words += count;
            figures.longest = figures.longest.max(count);
            if count > MOST_WORDS {
                figures.long_sentences.push((number, count));
            }
            figures.banned.extend(
                banned(sentence)
                    .into_iter()
                    .map(|(what, instead)| (number, what, instead)),
            );
        }
    }
    figures
}

/// The comment of a line, and its long strings.
fn comment_and_strings<'a>(line: &'a str, marks: &[&str]) -> (&'a str, Vec<&'a str>) {
    let mut strings = Vec::new();
    let (mut opened, mut escaped) = (None, false);
    for (at, c) in line.char_indices() {
        if opened.is_none() && marks.iter().any(|mark| line[at..].starts_with(mark)) {
            return (&line[at..], strings);
        }
        match (opened, c) {
            (None, '"') => opened = Some(at + 1),
            (Some(begin), '"') if !escaped => {
                if at - begin >= LEAST_MESSAGE_CHARACTERS {
                    strings.push(&line[begin..at]);
                }
                opened = None;
            }
            _ => {}
        }
        escaped = c == '\\' && !escaped;
    }
    ("", strings)
}

/// Comments and messages of a source.
fn source(text: &str, marks: &[&str]) -> Figures {
    let mut figures = Figures::default();
    for (number, line) in text
        .lines()
        .enumerate()
        .map(|(number, line)| (number + 1, line))
    {
        let (comment, strings) = comment_and_strings(line, marks);
        let is_all_comment = !comment.is_empty() && line.trim_start() == comment;
        if is_all_comment && line.chars().count() > MOST_COLUMNS {
            figures.long_lines.push((number, line.chars().count()));
        }
        for prose in std::iter::once(comment).chain(strings) {
            figures.banned.extend(
                banned(prose)
                    .into_iter()
                    .map(|(what, instead)| (number, what, instead)),
            );
        }
    }
    figures
}

fn is_page(file: &str) -> bool {
    Path::new(file)
        .extension()
        .is_some_and(|extension| extension == "md")
}

fn figures_of(file: &str) -> Result<Option<Figures>, String> {
    let marks: &[&str] = match Path::new(file)
        .extension()
        .and_then(|extension| extension.to_str())
    {
        Some("md") => &[],
        Some("rs" | "js") => &["//"],
        Some("py" | "toml" | "yml" | "cff") => &["#"],
        _ => return Ok(None),
    };
    let text =
        std::fs::read_to_string(root().join(file)).map_err(|error| format!("{file}: {error}"))?;
    Ok(Some(if marks.is_empty() {
        page(&text)
    } else {
        source(&text, marks)
    }))
}

/// What passes a limit in a file.
fn faults(file: &str, figures: &Figures) -> Vec<String> {
    let mut out = Vec::new();
    if figures.mean() > MOST_MEAN_WORDS_OF_PAGE {
        out.push(format!(
            "{file}: {:.1} words a sentence, at most {MOST_MEAN_WORDS_OF_PAGE}",
            figures.mean()
        ));
    }
    out.extend(
        figures
            .long_sentences
            .iter()
            .map(|(line, count)| format!("{file}:{line}: {count} words, at most {MOST_WORDS}")),
    );
    out.extend(
        figures
            .banned
            .iter()
            .map(|(line, what, instead)| format!("{file}:{line}: \"{what}\": {instead}")),
    );
    if !GENERATED.contains(&file) {
        out.extend(figures.long_lines.iter().map(|(line, columns)| {
            format!("{file}:{line}: {columns} columns, at most {MOST_COLUMNS}")
        }));
    }
    out
}

fn files() -> Result<Vec<String>, String> {
    let listed = Command::new("git")
        .args(["ls-files"])
        .current_dir(root())
        .output()
        .map_err(|error| format!("git ls-files: {error}"))?;
    if !listed.status.success() {
        return Err(format!(
            "git ls-files: {}",
            String::from_utf8_lossy(&listed.stderr)
        ));
    }
    let there = |file: &String| root().join(file).is_file();
    Ok(String::from_utf8_lossy(&listed.stdout)
        .lines()
        .map(String::from)
        .filter(there)
        .collect())
}

/// Every place in a file.
fn print_places(file: &str, figures: &Figures) {
    figures
        .long_sentences
        .iter()
        .for_each(|(line, words)| println!("{file}:{line}: a sentence of {words} words"));
    figures
        .banned
        .iter()
        .for_each(|(line, what, instead)| println!("{file}:{line}: \"{what}\": {instead}"));
    figures
        .long_lines
        .iter()
        .for_each(|(line, columns)| println!("{file}:{line}: {columns} columns"));
}

/// A table by file, or the places in the files that are named. What passes a limit in a page is an error;
/// with `--strict` in a source as well.
///
/// # Errors
/// What cannot be read, and what passes a limit.
pub fn report(is_strict: bool, named: &[String]) -> Result<(), String> {
    let mut all = Vec::new();
    for file in files()? {
        let is_wanted =
            named.is_empty() || named.iter().any(|name| Path::new(&file).starts_with(name));
        if let Some(figures) = if is_wanted { figures_of(&file)? } else { None } {
            all.push((file, figures));
        }
    }
    if all.is_empty() {
        return Err(format!(
            "no page or source among the files of the repository: {named:?}"
        ));
    }
    if !named.is_empty() {
        all.iter()
            .for_each(|(file, figures)| print_places(file, figures));
    }
    println!(
        "{:>9} {:>10} {:>8} {:>7} {:>11}  file",
        "sentences", "mean words", "longest", "banned", "long lines"
    );
    let (mut sentences, mut words, mut banned, mut long_lines) = (0, 0, 0, 0);
    let mut passed = Vec::new();
    for (file, figures) in &all {
        sentences += figures.sentences;
        words += figures.words;
        banned += figures.banned.len();
        long_lines += figures.long_lines.len();
        if is_strict || is_page(file) {
            passed.extend(faults(file, figures));
        }
        let (found, lines) = (figures.banned.len(), figures.long_lines.len());
        if figures.sentences > 0 {
            println!(
                "{:>9} {:>10.1} {:>8} {found:>7} {lines:>11}  {file}",
                figures.sentences,
                figures.mean(),
                figures.longest
            );
        } else if found + lines > 0 {
            println!(
                "{:>9} {:>10} {:>8} {found:>7} {lines:>11}  {file}",
                "", "", ""
            );
        }
    }
    let mean = if sentences == 0 {
        0.0
    } else {
        words as f64 / sentences as f64
    };
    println!(
        "{sentences:>9} {mean:>10.1} {:>8} {banned:>7} {long_lines:>11}  in all",
        ""
    );
    if mean > MOST_MEAN_WORDS {
        passed.push(format!(
            "all pages: {mean:.1} words a sentence, at most {MOST_MEAN_WORDS}"
        ));
    }
    match (passed.len(), named.is_empty()) {
        (0, _) => Ok(()),
        (_, true) => Err(passed.join("\n")),
        (count, false) => Err(format!("{count} faults")),
    }
}

#[cfg(test)]
mod tests {
    use super::{banned, comment_and_strings, faults, page, sentences};

    #[test]
    fn a_stop_before_a_capital_ends_a_sentence_and_one_in_a_number_does_not() {
        let parts: Vec<&str> =
            sentences("It takes 2.5 s, i.e. long. See `a. B` first; then **go.** Done")
                .into_iter()
                .map(|(_, text)| text)
                .collect();
        assert_eq!(
            parts,
            [
                "It takes 2.5 s, i.e. long.",
                "See `a. B` first;",
                "then **go.**",
                "Done"
            ]
        );
    }

    #[test]
    fn code_tables_and_headings_of_a_page_are_left_out() {
        let figures = page(
            "# A title of words\n\nOne two\nthree.\n\n    code of words\n\n| a | table |\n\n- [an item](far/away.md)\n  goes on\n\n```\nmore\n```\n\n<!-- a: written by b -->\nwords\n<!-- end of a -->\n",
        );
        assert_eq!(
            (figures.sentences, figures.words, figures.longest),
            (2, 7, 4)
        );
    }

    #[test]
    fn a_banned_word_is_found_over_the_end_of_a_line_with_its_line() {
        let figures = page("First.\nA cause is\ntold here.\n");
        assert_eq!(
            figures
                .banned
                .iter()
                .map(|(line, what, _)| (*line, *what))
                .collect::<Vec<_>>(),
            [(2, "is|are|was|were|been|be told")]
        );
        assert!(banned("a historical tolding of planes").is_empty());
    }

    #[test]
    fn a_long_sentence_and_a_long_line_are_faults_and_a_generated_page_keeps_its_lines() {
        let figures = page(&format!("{}end.\n", "word ".repeat(45)));
        let found = faults("README.md", &figures);
        assert_eq!(
            found,
            [
                "README.md: 46.0 words a sentence, at most 20",
                "README.md:1: 46 words, at most 45",
                "README.md:1: 229 columns, at most 110"
            ]
        );
        assert_eq!(faults("docs/reference/effects.md", &figures).len(), 2);
        assert!(faults("README.md", &page("It ends.\n")).is_empty());
    }

    #[test]
    fn a_source_has_comments_and_long_strings() {
        let line = r#"    call("https://example.org/a \" string", "short"); // why"#;
        assert_eq!(
            comment_and_strings(line, &["//"]),
            ("// why", vec![r#"https://example.org/a \" string"#])
        );
    }
}
