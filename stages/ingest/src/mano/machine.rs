//! The machine that runs the instructions of a binary pickle.

use std::collections::BTreeMap;

use super::pickle::{Ref, Value};

/// The machine that a pickle is a program for.
pub(super) struct Machine<'a> {
    bytes: &'a [u8],
    /// The next instruction.
    pub(super) at: usize,
    pub(super) values: Vec<Value<'a>>,
    stack: Vec<Ref>,
    /// Lengths of the stack where a run of items begins.
    marks: Vec<usize>,
    memo: BTreeMap<u64, Ref>,
}

const ENDS: &str = "the end of the file";
const EMPTY: &str = "an instruction that lacks its arguments";

impl<'a> Machine<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self {
            bytes,
            at: 0,
            values: Vec::new(),
            stack: Vec::new(),
            marks: Vec::new(),
            memo: BTreeMap::new(),
        }
    }

    /// Runs one instruction; returns the result once the pickle is complete.
    #[expect(clippy::too_many_lines, reason = "one arm per instruction")]
    pub(super) fn step(&mut self) -> Result<Option<Ref>, &'static str> {
        match self.u8()? {
            b'.' => return self.pop().map(Some),
            0x80 => {
                if !(2..=5).contains(&self.u8()?) {
                    return Err("a protocol other than 2 to 5");
                }
            }
            0x95 => drop(self.take(8)?), // A frame's length means nothing to us.
            b'(' => self.marks.push(self.stack.len()),
            b'0' => drop(self.pop()?),
            b'1' => drop(self.marked()?),
            b'2' => self.stack.push(self.top()?),
            b't' | b'l' => {
                let items = self.marked()?;
                self.push(Value::Sequence(items));
            }
            0x91 => {
                self.marked()?;
                self.push(Value::Other);
            }
            0x85 => self.push_tuple(1)?,
            0x86 => self.push_tuple(2)?,
            0x87 => self.push_tuple(3)?,
            b'd' => {
                let entries = pairs(&self.marked()?)?;
                self.push(Value::Dict(entries));
            }
            b'a' => {
                let item = self.pop()?;
                self.extend(&[item])?;
            }
            b'e' | 0x90 => {
                let items = self.marked()?;
                self.extend(&items)?;
            }
            b's' => {
                let value = self.pop()?;
                let key = self.pop()?;
                self.insert(&[key, value])?;
            }
            b'u' => {
                let items = self.marked()?;
                self.insert(&items)?;
            }
            b'c' => {
                self.line()?;
                let name = self.line()?;
                self.push(Value::Global(name));
            }
            0x93 => {
                let name = self.pop()?;
                self.pop()?;
                match self.values.get(name) {
                    Some(Value::Text(name)) => self.push(Value::Global(name.as_bytes())),
                    _ => return Err("a class whose name is not text"),
                }
            }
            b'R' | 0x81 => self.push_object()?,
            0x92 => {
                self.pop()?; // Arguments by name.
                self.push_object()?;
            }
            b'b' => {
                let given = self.pop()?;
                let object = self.top()?;
                match self.values.get_mut(object) {
                    Some(Value::Object { state, .. }) => *state = Some(given),
                    _ => return Err("a state for what is not an object"),
                }
            }
            b'q' => {
                let key = self.len(1)?;
                self.remember(key as u64)?;
            }
            b'r' => {
                let key = self.len(4)?;
                self.remember(key as u64)?;
            }
            0x94 => self.remember(self.memo.len() as u64)?,
            b'h' => {
                let key = self.len(1)?;
                self.recall(key as u64)?;
            }
            b'j' => {
                let key = self.len(4)?;
                self.recall(key as u64)?;
            }
            literal => self.literal(literal)?,
        }
        Ok(None)
    }

    /// Runs one instruction that only makes a value.
    fn literal(&mut self, instruction: u8) -> Result<(), &'static str> {
        match instruction {
            // A set takes items and forgets them.
            b'N' | 0x8f => self.push(Value::Other),
            0x88 => self.push(Value::Bool(true)),
            0x89 => self.push(Value::Bool(false)),
            b'J' => {
                let [a, b, c, d] = self.array()?;
                self.push(Value::Int(i32::from_le_bytes([a, b, c, d]).into()));
            }
            b'K' => self.counted_int(1)?,
            b'M' => self.counted_int(2)?,
            0x8a => {
                let len = self.len(1)?;
                self.long(len)?;
            }
            0x8b => {
                let len = self.len(4)?;
                self.long(len)?;
            }
            b'G' => {
                self.take(8)?;
                self.push(Value::Other);
            }
            b'U' | b'C' => self.push_bytes(1)?,
            b'T' | b'B' => self.push_bytes(4)?,
            0x8e | 0x96 => self.push_bytes(8)?,
            0x8c => self.push_text(1)?,
            b'X' => self.push_text(4)?,
            0x8d => self.push_text(8)?,
            b']' | b')' => self.push(Value::Sequence(Vec::new())),
            b'}' => self.push(Value::Dict(Vec::new())),
            _ => return Err("an instruction that is none of a binary pickle's"),
        }
        Ok(())
    }

    fn take(&mut self, n: usize) -> Result<&'a [u8], &'static str> {
        let end = self.at.checked_add(n).ok_or(ENDS)?;
        let taken = self.bytes.get(self.at..end).ok_or(ENDS)?;
        self.at = end;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], &'static str> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    fn u8(&mut self) -> Result<u8, &'static str> {
        let [byte] = self.array()?;
        Ok(byte)
    }

    /// Reads a length of `width` bytes, the lowest first.
    fn len(&mut self, width: usize) -> Result<usize, &'static str> {
        let mut number = 0_u64;
        for &byte in self.take(width)?.iter().rev() {
            number = number << 8 | u64::from(byte);
        }
        usize::try_from(number).map_err(|_too_long| ENDS)
    }

    /// Reads up to the end of the line, which is not part of what is returned.
    fn line(&mut self) -> Result<&'a [u8], &'static str> {
        let rest = self.bytes.get(self.at..).ok_or(ENDS)?;
        let len = rest.iter().position(|&byte| byte == b'\n').ok_or(ENDS)?;
        let line = self.take(len)?;
        self.take(1)?;
        Ok(line)
    }

    fn push(&mut self, value: Value<'a>) {
        self.stack.push(self.values.len());
        self.values.push(value);
    }

    fn counted_int(&mut self, width: usize) -> Result<(), &'static str> {
        let number = self.len(width)?;
        self.push(i64::try_from(number).map_or(Value::Other, Value::Int));
        Ok(())
    }

    /// Reads a whole number of `len` bytes, the lowest first, in two's complement.
    fn long(&mut self, len: usize) -> Result<(), &'static str> {
        let bytes = self.take(len)?;
        let negative = bytes.last().is_some_and(|byte| byte & 0x80 != 0);
        let mut padded = [if negative { 0xff } else { 0 }; 8];
        let value = match padded.get_mut(..len) {
            Some(low) => {
                low.copy_from_slice(bytes);
                Value::Int(i64::from_le_bytes(padded))
            }
            None => Value::Other,
        };
        self.push(value);
        Ok(())
    }

    fn push_bytes(&mut self, width: usize) -> Result<(), &'static str> {
        let len = self.len(width)?;
        let bytes = self.take(len)?;
        self.push(Value::Bytes(bytes));
        Ok(())
    }

    fn push_text(&mut self, width: usize) -> Result<(), &'static str> {
        let len = self.len(width)?;
        let text =
            std::str::from_utf8(self.take(len)?).map_err(|_bad| "a text that is not UTF-8")?;
        self.push(Value::Text(text));
        Ok(())
    }

    fn push_tuple(&mut self, n: usize) -> Result<(), &'static str> {
        let start = self.stack.len().checked_sub(n).ok_or(EMPTY)?;
        if self.marks.last().is_some_and(|&mark| start < mark) {
            return Err(EMPTY);
        }
        let items = self.stack.split_off(start);
        self.push(Value::Sequence(items));
        Ok(())
    }

    fn push_object(&mut self) -> Result<(), &'static str> {
        let args = self.pop()?;
        let callable = self.pop()?;
        self.push(Value::Object {
            callable,
            args,
            state: None,
        });
        Ok(())
    }

    fn top(&self) -> Result<Ref, &'static str> {
        let bottom = self.marks.last().copied().unwrap_or(0);
        let above = self.stack.get(bottom..).ok_or(EMPTY)?;
        above.last().copied().ok_or(EMPTY)
    }

    fn pop(&mut self) -> Result<Ref, &'static str> {
        let top = self.top()?;
        self.stack.pop();
        Ok(top)
    }

    /// Takes everything above the last mark.
    fn marked(&mut self) -> Result<Vec<Ref>, &'static str> {
        let mark = self.marks.pop().ok_or(EMPTY)?;
        if mark > self.stack.len() {
            return Err(EMPTY);
        }
        Ok(self.stack.split_off(mark))
    }

    fn extend(&mut self, more: &[Ref]) -> Result<(), &'static str> {
        let list = self.top()?;
        match self.values.get_mut(list) {
            Some(Value::Sequence(items)) => items.extend(more),
            Some(Value::Other) => {}
            _ => return Err("items for what is not a list"),
        }
        Ok(())
    }

    fn insert(&mut self, items: &[Ref]) -> Result<(), &'static str> {
        let dict = self.top()?;
        match self.values.get_mut(dict) {
            Some(Value::Dict(entries)) => entries.extend(pairs(items)?),
            // Some classes are dictionaries and take entries like one; none of a hand model's is.
            Some(Value::Object { .. }) => {}
            _ => return Err("entries for what is not a dictionary"),
        }
        Ok(())
    }

    fn remember(&mut self, key: u64) -> Result<(), &'static str> {
        let top = self.top()?;
        self.memo.insert(key, top);
        Ok(())
    }

    fn recall(&mut self, key: u64) -> Result<(), &'static str> {
        let value = *self.memo.get(&key).ok_or("a reference to nothing")?;
        self.stack.push(value);
        Ok(())
    }
}

/// Returns keys with their values.
fn pairs(items: &[Ref]) -> Result<Vec<(Ref, Ref)>, &'static str> {
    let (pairs, rest) = items.as_chunks::<2>();
    if rest.is_empty() {
        Ok(pairs.iter().map(|&[key, value]| (key, value)).collect())
    } else {
        Err("a key without a value")
    }
}
