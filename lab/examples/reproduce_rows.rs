//! Prints the figures of the given chapters beside the goals.
fn main() {
    let goals = hysteron::reproduce::goals().unwrap_or_default();
    for number in std::env::args().skip(1).filter_map(|a| a.parse().ok()) {
        let from = std::time::Instant::now();
        match hysteron::reproduce::chapter(number, &|s| eprintln!("{s}")) {
            Ok(chapter) => {
                for row in &chapter.rows {
                    let goal = goals.iter().find(|g| g.id == row.id).and_then(|g| g.goal);
                    let mark = match goal {
                        Some(g) if row.ours <= g => "ok  ",
                        Some(_) => "MISS",
                        None => "    ",
                    };
                    println!(
                        "{mark} {:36} {:12.6} {:8} {:8} {}",
                        row.id,
                        row.ours,
                        goal.map_or(String::new(), |g| g.to_string()),
                        row.unit,
                        row.note
                    );
                }
                for g in goals.iter().filter(|g| g.chapter == number && !chapter.rows.iter().any(|r| r.id == g.id)) {
                    println!("LACK {}", g.id);
                }
            }
            Err(e) => println!("chapter {number}: {e}"),
        }
        println!("chapter {number}: {:.1} s", from.elapsed().as_secs_f64());
    }
}
