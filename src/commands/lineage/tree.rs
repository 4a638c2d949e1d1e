//! Lineage as an indented tree.

use crate::report;

/// Maximum children shown per group.
const MAX_CHILDREN: usize = 3;

/// A node of the tree.
pub(super) struct TreeNode {
    /// Its name and further columns.
    pub(super) cells: Vec<String>,
    /// Its children, by position, in groups that are truncated separately.
    pub(super) groups: Vec<Group>,
    /// Its children without children.
    pub(super) leaves: Vec<Vec<String>>,
}

/// Children of one kind.
#[derive(Clone)]
pub(super) struct Group {
    /// Their kind.
    pub(super) name: String,
    pub(super) members: Vec<usize>,
}

/// Lays out the tree of the first node. The subtree of a repeated node is shown only at its first
/// occurrence.
pub(super) fn text(nodes: impl Iterator<Item = TreeNode>) -> String {
    let nodes: Vec<TreeNode> = nodes.collect();
    let mut tree = Tree {
        is_shown: vec![false; nodes.len()],
        nodes: &nodes,
        rows: Vec::new(),
    };
    tree.grow(0, "", "");
    report::columns(&tree.rows, &[])
}

struct Tree<'a> {
    nodes: &'a [TreeNode],
    is_shown: Vec<bool>,
    rows: Vec<Vec<String>>,
}

/// A child line.
enum ChildLine<'a> {
    Node(usize),
    Leaf(&'a [String]),
    More(String),
}

impl Tree<'_> {
    /// Adds a node; `first` stands before its own line, `others` before those below it.
    fn grow(&mut self, position: usize, first: &str, others: &str) {
        let nodes = self.nodes;
        let (Some(node), Some(is_shown)) = (nodes.get(position), self.is_shown.get_mut(position))
        else {
            return;
        };
        let mut cells = node.cells.clone();
        let has_more = !node.groups.is_empty() || !node.leaves.is_empty();
        if *is_shown && has_more {
            cells.push("as above".to_owned());
        }
        self.rows.push(with_prefix(first, cells));
        if std::mem::replace(is_shown, true) {
            return;
        }
        let mut below = Vec::new();
        for group in &node.groups {
            cut(&mut below, &group.members, &group.name, |&idx| {
                ChildLine::Node(idx)
            });
        }
        cut(&mut below, &node.leaves, "files", |leaf| {
            ChildLine::Leaf(leaf)
        });
        let n_below = below.len();
        for (idx, below) in below.into_iter().enumerate() {
            let (branch, line) = if idx + 1 == n_below {
                ("└─ ", "   ")
            } else {
                ("├─ ", "│  ")
            };
            let first = format!("{others}{branch}");
            match below {
                ChildLine::Node(position) => {
                    self.grow(position, &first, &format!("{others}{line}"));
                }
                ChildLine::Leaf(cells) => self.rows.push(with_prefix(&first, cells.to_vec())),
                ChildLine::More(text) => self.rows.push(vec![format!("{first}{text}")]),
            }
        }
    }
}

/// Takes the first items of a list, and counts the rest.
fn cut<'a, T>(
    below: &mut Vec<ChildLine<'a>>,
    list: &'a [T],
    name: &str,
    of: impl Fn(&'a T) -> ChildLine<'a>,
) {
    // Replacing a single line by a count saves nothing.
    let n_shown = if list.len() == MAX_CHILDREN + 1 {
        MAX_CHILDREN + 1
    } else {
        MAX_CHILDREN
    };
    below.extend(list.iter().take(n_shown).map(of));
    if list.len() > n_shown {
        below.push(ChildLine::More(format!(
            "… {} more {name}",
            list.len() - n_shown
        )));
    }
}

fn with_prefix(prefix: &str, mut cells: Vec<String>) -> Vec<String> {
    if let Some(name) = cells.first_mut() {
        name.insert_str(0, prefix);
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(name: &str, groups: &[&[usize]], n_leaves: usize) -> TreeNode {
        let group = |members: &&[usize]| Group {
            name: "others".to_owned(),
            members: members.to_vec(),
        };
        TreeNode {
            cells: vec![name.to_owned()],
            groups: groups.iter().map(group).collect(),
            leaves: (0..n_leaves)
                .map(|idx| vec![format!("leaf {idx}")])
                .collect(),
        }
    }

    #[test]
    fn lists_are_cut_and_repeats_shown_once() {
        let nodes = || {
            [
                node("root", &[&[1, 2]], 0),
                node("a", &[&[2]], 6),
                node("b", &[], 1),
            ]
        };
        let expected = "\
root
├─ a
│  ├─ b
│  │  └─ leaf 0
│  ├─ leaf 0
│  ├─ leaf 1
│  ├─ leaf 2
│  └─ … 3 more files
└─ b  as above
";
        // Columns are aligned, so the mark of `b` is after the longest name.
        let squeezed = |text: &str| {
            let lines = text
                .lines()
                .map(|line| line.replace("   as above", " as above"));
            lines
                .map(|line| {
                    line.split("  as")
                        .next()
                        .unwrap_or("")
                        .trim_end()
                        .to_owned()
                })
                .collect::<Vec<_>>()
        };
        assert_eq!(squeezed(&text(nodes().into_iter())), squeezed(expected));
        assert!(text(nodes().into_iter()).ends_with("as above\n"));
    }
}
