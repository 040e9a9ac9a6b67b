//! The lab page, put together: once as a file with the library inside it, once as the program `hysteron lab`
//! serves it. One page, two engines. And the page of `hysteron board scope`, which draws with the same plots.

/// Curves on a canvas, of both pages.
const PLOT: &str = include_str!("plot.js");
/// The scope, and what it has beside the lab's style and plots.
const SCOPE: [&str; 3] = [
    include_str!("scope.html"),
    include_str!("scope.css"),
    include_str!("scope.js"),
];
/// Everything a person sees and does.
const TEMPLATE: &str = include_str!("lab.html");
const STYLE: &str = include_str!("lab.css");
/// How questions and answers are written as bytes; the worker needs it too.
const MESSAGES: &str = include_str!("messages.js");
const WORKER: &str = include_str!("worker.js");
const SCRIPTS: [&str; 5] = [
    include_str!("worker_engine.js"),
    include_str!("served_engine.js"),
    PLOT,
    include_str!("servo_panel.js"),
    include_str!("lab.js"),
];
/// What a page from disk may connect to, in its content security policy.
const NO_CONNECTION: &str = "connect-src 'none'";

/// The page as one file that works from disk.
///
/// `module` is the library and `example` the JSON of `hysteron_examples::HIDDEN_EFFECT`, both packed by gzip
/// and written in base64.
///
/// # Errors
/// What does not fit into the page.
pub fn from_disk(module: &str, example: &str) -> Result<String, String> {
    put_together(module, example, TEMPLATE)
}

/// The page as it is served: without a module it asks the program that serves it, and nobody else.
///
/// # Errors
/// What does not fit into the page.
pub fn served() -> Result<String, String> {
    once(TEMPLATE, NO_CONNECTION)?;
    put_together(
        "",
        "",
        &TEMPLATE.replace(NO_CONNECTION, "connect-src 'self'"),
    )
}

fn once(text: &str, place: &str) -> Result<(), String> {
    if text.matches(place).count() == 1 {
        Ok(())
    } else {
        Err(format!("lab/browser/web/lab.html: expected {place} once"))
    }
}

/// The page of the scope.
///
/// # Errors
/// What does not fit into the page.
pub fn scope() -> Result<String, String> {
    let [template, style, script] = SCOPE;
    let (style, script) = ([STYLE, style].concat(), [PLOT, script].concat());
    fill(template, &[("/*STYLE*/", &style), ("/*SCRIPT*/", &script)])
}

fn put_together(module: &str, example: &str, template: &str) -> Result<String, String> {
    let (worker, script) = (
        [MESSAGES, WORKER].concat(),
        [&[MESSAGES][..], &SCRIPTS].concat().concat(),
    );
    let parts = [
        ("/*STYLE*/", STYLE),
        ("/*WORKER*/", worker.as_str()),
        ("/*SCRIPT*/", script.as_str()),
        ("<!--MODULE-->", module),
        ("<!--EXAMPLE-->", example),
    ];
    fill(template, &parts)
}

/// Puts contents into their places.
fn fill(template: &str, parts: &[(&str, &str)]) -> Result<String, String> {
    let mut page = template.to_owned();
    for &(place, content) in parts {
        once(&page, place)?;
        if content.contains("</script") || content.contains("</style") {
            return Err(format!("what goes into {place} ends its own element"));
        }
        page = page.replace(place, content);
    }
    Ok(page)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_page_for_both_engines() {
        let (disk, served) = (
            from_disk("bW9kdWxl", "ZXhhbXBsZQ==").unwrap(),
            served().unwrap(),
        );
        assert!(disk.contains(NO_CONNECTION) && !served.contains(NO_CONNECTION));
        let without_engine = disk
            .replace(NO_CONNECTION, "connect-src 'self'")
            .replace("bW9kdWxl", "")
            .replace("ZXhhbXBsZQ==", "");
        assert_eq!(without_engine, served);
        assert!(from_disk("</script>", "").is_err());
    }

    #[test]
    fn the_scope_is_one_page_that_asks_nobody_else() {
        let page = scope().unwrap();
        assert!(
            page.contains("class Plot")
                && page.contains("Hysteron scope")
                && !page.contains("/*SCRIPT*/")
        );
        assert!(
            !page.contains("src=") && !page.contains("https:"),
            "the page loads nothing"
        );
    }
}
