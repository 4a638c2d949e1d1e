"""Random statements over random tables, each with what stands in it."""

import datetime
import random

# Types of columns and expressions.
INT, FLOAT, TEXT, BOOL, DATE, TIME = "int", "float", "text", "bool", "date", "time"
WORDS = ["", "a", "b", "ab", "Ab", "cup", "mug", "007", "25", "a%b", "a_b", "é", "can't", "x y"]
DAYS = [datetime.date(2023, 12, 31) + datetime.timedelta(days=n) for n in (0, 1, 2, 30, 59, 60, 61, 100, 366)]


def quoted(text):
    return "'" + text.replace("'", "''") + "'"


class Tables:
    """A few tables with nulls, ties, one unique key each, and names that need quotes."""

    def __init__(self, rng):
        self.rng, self.columns, self.rows = rng, {}, {}
        for table in ("t1", "t2", "t3"):
            columns = [("id", INT), ("k", INT), ("g", TEXT), ("n", INT), ("x", FLOAT), ("b", BOOL), ("d", DATE), ("s", TIME)]
            columns += rng.sample([("Name X", TEXT), ("order", INT), ("y", FLOAT), ("m", INT), ("day of", DATE)], 3)
            n_rows = rng.choice([0, 1, 5, 12, 25]) if table == "t3" else rng.choice([6, 12, 25])
            null = rng.choice([0.0, 0.15, 0.4])
            self.columns[table] = columns
            self.rows[table] = [
                [n if name == "id" else None if rng.random() < null else self.value(kind) for name, kind in columns]
                for n in range(n_rows)
            ]

    def value(self, kind):
        rng = self.rng
        if kind == INT:
            return rng.choice([0, 1, 2, 3, 3, 5, -1, -4, 10, 2**31, 10**6] + [2**62] * (rng.random() < 0.02))
        if kind == FLOAT:
            return rng.choice([0.0, -0.0, 0.25, 0.5, 1.0, 1.5, -2.75, 3.0, 1e6, -0.125])
        if kind == TEXT:
            return rng.choice(WORDS)
        if kind == BOOL:
            return rng.random() < 0.5
        if kind == DATE:
            return rng.choice(DAYS)
        return datetime.datetime.combine(rng.choice(DAYS), datetime.time(rng.choice([0, 6, 23]), rng.choice([0, 59]), rng.choice([0, 30])))


class Statements:
    """Makes statements."""

    def __init__(self, rng, tables, path):
        self.rng, self.tables, self.path = rng, tables, path

    # Where columns come from.

    def name(self, name):
        return f'"{name}"' if not name.islower() or " " in name or name == "order" or self.chance(0.05) else name

    def chance(self, share):
        return self.rng.random() < share

    def table(self, alias=None):
        table = self.rng.choice(["t1", "t1", "t2", "t2", "t3"])
        alias = alias or self.alias()
        columns = [(f"{alias}.{self.name(name)}", kind) for name, kind in self.tables.columns[table]]
        return f"'{self.path(table)}' {self.rng.choice(['', 'as '])}{alias}", columns

    def alias(self):
        self.n_aliases += 1
        return f"r{self.n_aliases}"

    def source(self, depth=0):
        """Returns the text after `from`, its columns, and those that are a key of its rows."""
        roll = self.rng.random()
        if roll < 0.42:
            text, columns = self.table()
            return text, columns, columns[:1]
        if roll < 0.55 and depth < 2:
            self.has.add("subquery")
            alias = self.alias()
            query, kinds = self.select(depth + 1)
            names = [f"c{n}" for n in range(len(kinds))]
            return f"({query}) as {alias}({', '.join(names)})", [(f"{alias}.{n}", k) for n, k in zip(names, kinds)], []
        return self.join(depth)

    def join(self, depth):
        self.has.add("join")
        left, columns = self.table()
        keys = columns[:1]
        for _ in range(self.rng.choice([1, 1, 1, 2])):
            right, added = self.table()
            kind = self.rng.choice(["join", "inner join", "left join", "left join", "left outer join", "right join", "full join", "full outer join", "cross join"])
            if kind == "cross join":
                left = f"{left} cross join {right}"
            else:
                left = f"{left} {kind} {right} on {self.condition(columns, added)}"
            columns, keys = columns + added, keys + added[:1]
        return left, columns, keys

    def condition(self, left, right):
        parts = []
        if self.chance(0.9):
            kind = self.rng.choice([INT, INT, TEXT, DATE])
            parts.append(f"{self.column(left, kind)} = {self.column(right, kind)}")
        if self.chance(0.55) or not parts:
            self.has.add("one-sided")
            parts.append(self.predicate(self.rng.choice([left, right]), 0))
        if self.chance(0.1):
            parts.append(f"{self.column(left, INT)} {self.rng.choice(['<', '<=', '<>'])} {self.column(right, INT)}")
        self.rng.shuffle(parts)
        return " and ".join(parts)

    def column(self, columns, kind):
        fit = [name for name, of in columns if of == kind]
        return self.rng.choice(fit) if fit else self.literal(kind)

    # Expressions of one row.

    def literal(self, kind):
        rng = self.rng
        if kind == INT:
            return str(rng.choice([0, 1, 2, 3, 5, 10, -1]))
        if kind == FLOAT:
            return rng.choice(["0.5", "1.5", "2.0", "-0.25", "1e0", "0.0"])
        if kind == TEXT:
            return quoted(rng.choice(WORDS))
        if kind == BOOL:
            return rng.choice(["true", "false"])
        self.has.add("date")
        day = rng.choice(DAYS)
        if kind == DATE:
            return rng.choice([f"date '{day}'", f"cast('{day}' as date)"])
        return f"timestamp '{day} {rng.choice(['00:00:00', '06:59:30', '23:00:00'])}'"

    def expression(self, columns, kind, depth=2):
        rng = self.rng
        if kind in (DATE, TIME):
            self.has.add("date")
        if depth <= 0 or self.chance(0.35):
            return self.column(columns, kind) if self.chance(0.8) else self.literal(kind)
        e = lambda of: self.expression(columns, of, depth - 1)
        if self.chance(0.12):
            parts = " ".join(f"when {self.predicate(columns, depth - 1)} then {e(kind)}" for _ in range(rng.choice([1, 2])))
            return f"case {parts} {'else ' + e(kind) if self.chance(0.6) else ''} end"
        if self.chance(0.1):
            self.has.add("null")
            return rng.choice([f"coalesce({e(kind)}, {e(kind)})", f"nullif({e(kind)}, {e(kind)})", f"coalesce(null, {e(kind)})"])
        if kind == INT:
            return rng.choice([
                lambda: f"({e(INT)} {rng.choice('+-')} {e(INT)})", lambda: f"({e(INT)} * {self.literal(INT)})",
                lambda: f"abs({e(INT)})", lambda: f"length({e(TEXT)})", lambda: f"({e(INT)} % {rng.choice([2, 3, 7])})",
                lambda: f"-({self.column(columns, INT)})", lambda: f"greatest({e(INT)}, {e(INT)})", lambda: f"least({e(INT)}, {e(INT)})",
                lambda: f"extract({rng.choice(['year', 'month', 'day', 'dow', 'doy', 'quarter', 'week'])} from {self.dated(columns)})",
                lambda: f"date_part('{rng.choice(['year', 'month', 'day', 'dow', 'isodow', 'hour', 'minute'])}', {self.expression(columns, TIME, 0)})",
                lambda: f"cast({e(BOOL)} as int)", lambda: f"cast(round({e(FLOAT)}) as bigint)", lambda: f"strpos({e(TEXT)}, {quoted(rng.choice(['a', 'b', 'u']))})",
                lambda: f"({self.expression(columns, DATE, 0)} - {self.expression(columns, DATE, 0)})", lambda: f"cast({quoted(str(rng.randint(-9, 99)))} as bigint)",
            ])()
        if kind == FLOAT:
            return rng.choice([
                lambda: f"({e(FLOAT)} {rng.choice('+-*')} {e(FLOAT)})", lambda: f"({e(INT)} / {e(INT)})", lambda: f"({e(FLOAT)} / {self.literal(INT)})",
                lambda: f"({e(INT)} * {e(FLOAT)})", lambda: f"round({e(FLOAT)}, {rng.choice([0, 1, 2])})", lambda: f"floor({e(FLOAT)})", lambda: f"ceil({e(FLOAT)})",
                lambda: f"sqrt(abs({e(FLOAT)}))", lambda: f"cast({e(INT)} as double)", lambda: f"abs({e(FLOAT)})", lambda: f"power({e(FLOAT)}, 2)", lambda: f"-({self.column(columns, FLOAT)})",
                lambda: f"round({e(FLOAT)})", lambda: f"trunc({e(FLOAT)})",
            ])()
        if kind == TEXT:
            return rng.choice([
                lambda: f"upper({e(TEXT)})", lambda: f"lower({e(TEXT)})", lambda: f"({e(TEXT)} || {e(TEXT)})", lambda: f"concat({e(TEXT)}, '-', {e(TEXT)})",
                lambda: f"substr({e(TEXT)}, {rng.choice([1, 2])}, {rng.choice([1, 2])})", lambda: f"substring({e(TEXT)} from 2)", lambda: f"left({e(TEXT)}, 1)", lambda: f"right({e(TEXT)}, 2)",
                lambda: f"replace({e(TEXT)}, 'a', 'o')", lambda: f"trim({e(TEXT)})", lambda: f"reverse({e(TEXT)})", lambda: f"repeat({e(TEXT)}, 2)", lambda: f"lpad({e(TEXT)}, 3, '.')",
                lambda: f"split_part({e(TEXT)}, 'b', 1)", lambda: f"cast({e(INT)} as varchar)", lambda: f"cast({self.expression(columns, DATE, 0)} as varchar)", lambda: f"cast({self.column(columns, FLOAT)} + 0e0 as varchar)" if any(k == FLOAT for _, k in columns) else "'f'",
            ])()
        if kind == BOOL:
            return f"({self.predicate(columns, depth - 1)})"
        if kind == DATE:
            return rng.choice([
                lambda: f"cast({self.expression(columns, TIME, 0)} as date)", lambda: f"({self.column(columns, DATE)} + {rng.choice([1, 7, 30])})", lambda: self.column(columns, DATE),
                lambda: f"cast(date_trunc('{rng.choice(['month', 'year', 'week'])}', {self.dated(columns)}) as date)", lambda: f"make_date({rng.choice([2023, 2024])}, {rng.randint(1, 12)}, {rng.randint(1, 28)})",
            ])()
        return rng.choice([
            lambda: f"date_trunc('{rng.choice(['hour', 'day', 'month', 'year', 'week', 'quarter'])}', {self.expression(columns, TIME, 0)})", lambda: f"cast({self.column(columns, DATE)} as timestamp)",
            lambda: f"({self.expression(columns, TIME, 0)} {rng.choice('+-')} interval '{rng.choice(['1 day', '2 hours', '1 month'])}')", lambda: f"({self.column(columns, DATE)} + interval '{rng.choice(['1 month', '3 days'])}')",
        ])()

    def dated(self, columns):
        return self.expression(columns, self.rng.choice([DATE, TIME]), 0)

    def predicate(self, columns, depth=1):
        rng = self.rng
        if depth > 0 and self.chance(0.3):
            sides = [self.predicate(columns, depth - 1) for _ in range(2)]
            return rng.choice([f"({sides[0]} and {sides[1]})", f"({sides[0]} or {sides[1]})", f"not ({sides[0]})"])
        kind = rng.choice([INT, INT, FLOAT, TEXT, DATE, TIME])
        if kind in (DATE, TIME):
            self.has.add("date")
        a = self.expression(columns, kind, depth)
        b = lambda: self.expression(columns, kind, depth - 1) if self.chance(0.4) else self.literal(kind)
        roll = rng.random()
        if roll < 0.45:
            return f"{a} {rng.choice(['=', '<>', '!=', '<', '<=', '>', '>='])} {b()}"
        if roll < 0.6:
            self.has.add("null")
            return rng.choice([f"{a} is null", f"{a} is not null", f"{a} is distinct from {b()}", f"{a} is not distinct from {b()}"])
        if roll < 0.7:
            return f"{a} {rng.choice(['', 'not '])}between {b()} and {b()}"
        if roll < 0.82:
            items = [self.literal(kind) for _ in range(rng.choice([1, 2, 3]))]
            if self.chance(0.25):
                self.has.add("null")
                items.append("null")
            return f"{a} {rng.choice(['', 'not '])}in ({', '.join(items)})"
        if roll < 0.93:
            pattern = rng.choice(["'a%'", "'%b'", "'_'", "'%u%'", "'A%'", "'%'", "''"])
            return f"{self.expression(columns, TEXT, depth)} {rng.choice(['like', 'not like', 'ilike'])} {pattern}"
        if any(of == BOOL for _, of in columns):
            return rng.choice(["", "not "]) + self.column(columns, BOOL)
        return rng.choice(["true", "false", "null = null", "1 = 1"])

    # Subqueries in conditions and values.

    def where(self, columns, depth):
        parts = []
        if self.chance(0.55):
            parts.append(self.predicate(columns, 2))
        if self.chance(0.22) and depth < 2:
            found = self.subquery_predicate(columns)
            if self.chance(0.3):
                other = self.predicate(columns, 1)
                found = self.rng.choice([f"not ({found})", f"({found} or {other})", f"not ({found} and {other})", f"case when {found} then {other} else true end"])
            parts.append(found)
        return f" where {' and '.join(parts)}" if parts else ""

    def correlated(self, inner, outer):
        kind = self.rng.choice([INT, INT, TEXT, DATE])
        fit = [name for name, of in outer if of == kind]
        if not fit:
            return self.predicate(inner, 1)
        return f"{self.column(inner, kind)} {self.rng.choice(['=', '=', '=', '<', '<>'])} {self.rng.choice(fit)}"

    def subquery_predicate(self, columns):
        self.has.add("subquery")
        rng = self.rng
        inner, own = self.table()
        conditions = [self.predicate(own, 1)] if self.chance(0.5) else []
        if self.chance(0.5):
            conditions.append(self.correlated(own, columns))
        where = f" where {' and '.join(conditions)}" if conditions else ""
        roll = rng.random()
        if roll < 0.3:
            return f"{rng.choice(['', 'not '])}exists (select {rng.choice(['1', '*', own[0][0]])} from {inner}{where})"
        kind = rng.choice([INT, INT, TEXT, DATE])
        if roll < 0.75:
            self.has.add("null")
            return f"{self.expression(columns, kind, 1)} {rng.choice(['in', 'not in'])} (select {self.column(own, kind)} from {inner}{where})"
        return f"{self.expression(columns, INT, 1)} {rng.choice(['<', '>', '=', '<='])} {self.scalar_subquery(columns)}"

    def scalar_subquery(self, columns):
        self.has.add("subquery")
        inner, own = self.table()
        conditions = [self.predicate(own, 0)] if self.chance(0.4) else []
        if self.chance(0.5):
            conditions.append(self.correlated(own, columns))
        where = f" where {' and '.join(conditions)}" if conditions else ""
        value = self.rng.choice(["count(*)", f"max({self.column(own, INT)})", f"min({self.column(own, INT)})", f"count({self.column(own, TEXT)})", f"sum({self.column(own, INT)})"])
        return f"(select {value} from {inner}{where})"

    # Many rows.

    def aggregate(self, columns, exact=False):
        """Returns an aggregate and its type."""
        rng = self.rng
        over = "" if self.chance(0.75) else f" filter (where {self.predicate(columns, 1)})"
        distinct = "distinct " if self.chance(0.15) else ""
        x = lambda kind: self.expression(columns, kind, 1)
        choices = [
            (3, lambda: ("count(*)" + over, INT)), (2, lambda: (f"count({distinct}{x(rng.choice([INT, TEXT, DATE, FLOAT]))}){over}", INT)),
            (3, lambda: (f"sum({distinct}{x(INT)}){over}", INT)), (2, lambda: (f"sum({x(FLOAT)}){over}", FLOAT)), (2, lambda: (f"avg({x(rng.choice([INT, FLOAT]))}){over}", FLOAT)),
        ]
        for function in ("min", "max"):
            kind = rng.choice([INT, FLOAT, TEXT, DATE, TIME])
            choices.append((1, lambda function=function, kind=kind: (f"{function}({x(kind)}){over}", kind)))
        choices.append((1, lambda: (f"sum(case when {self.predicate(columns, 1)} then 1 else 0 end)", INT)))
        choices.append((1, lambda: (f"median({x(rng.choice([INT, FLOAT]))}){over}", FLOAT)))
        choices.append((0.5, lambda: (f"{rng.choice(['bool_and', 'bool_or'])}({x(BOOL)}){over}", BOOL)))
        if not exact:
            choices.append((1, lambda: (f"quantile_cont({self.column(columns, rng.choice([INT, FLOAT]))}, {rng.choice([0, 0.25, 0.5, 0.9, 1])}){over}", "rough")))
            choices.append((1, lambda: (f"{rng.choice(['stddev', 'stddev_samp', 'stddev_pop', 'var_samp', 'var_pop', 'variance'])}({self.column(columns, rng.choice([INT, FLOAT]))}){over}", "rough")))
        return rng.choices([make for _, make in choices], [weight for weight, _ in choices])[0]()

    def window(self, columns, keys, over_groups=False):
        """Returns a window function and its type."""
        self.has.add("window")
        rng = self.rng
        partition = f"partition by {self.expression(columns, rng.choice([TEXT, INT, BOOL, DATE]), 1)} " if self.chance(0.5) else ""
        direction = lambda: rng.choice(["", " desc", " asc", " nulls first", " desc nulls first", " desc nulls last"])
        x = lambda kind: self.expression(columns, kind, 1)
        total = ", ".join(name + direction() for name, _ in keys)
        roll = rng.random()
        order = f"order by {x(rng.choice([INT, TEXT, DATE, FLOAT]))}{direction()}"
        functions = [(f"sum({x(INT)})", INT), (f"count({x(INT)})", INT), ("count(*)", INT), (f"min({x(INT)})", INT), (f"max({x(FLOAT)})", FLOAT), (f"avg({x(INT)})", FLOAT), (f"sum({x(FLOAT)})", FLOAT)]
        if roll < 0.3:
            call, kind = rng.choice(functions)
            return f"{call} over ({partition.strip()})", kind
        if roll < 0.6:
            call, kind = rng.choice(functions + [("rank()", INT), ("dense_rank()", INT), ("rank()", INT), ("percent_rank()", FLOAT), ("cume_dist()", FLOAT)])
            return f"{call} over ({partition}{order})", kind
        if not keys:
            return f"count(*) over ({partition.strip()})", INT
        if roll < 0.8:
            frame = rng.choice(["rows between 1 preceding and current row", "rows between unbounded preceding and current row", "rows between current row and 2 following", "rows between 1 preceding and 1 following", "rows unbounded preceding", "rows between 2 preceding and 1 preceding"])
            call, kind = rng.choice(functions + [(f"first_value({x(INT)})", INT), (f"last_value({x(TEXT)})", TEXT)])
            return f"{call} over ({partition}order by {total} {frame})", kind
        of = rng.choice([INT, TEXT, DATE, FLOAT])
        call, kind = rng.choice([("row_number()", INT), (f"lag({x(of)})", of), (f"lead({x(of)}, 2)", of), (f"lag({self.column(columns, INT)}, 1, 0)", INT), ("ntile(3)", INT), (f"first_value({x(of)})", of), (f"last_value({x(of)})", of)])
        return f"{call} over ({partition}order by {total})", kind

    # Whole selections.

    def select(self, depth=0):
        """Returns a selection without an order, and the types of its columns."""
        roll = self.rng.random()
        if depth < 2 and roll < 0.08:
            return self.set_operation(depth)
        if roll < 0.45:
            return self.grouped(depth)
        return self.plain(depth)

    def kind(self):
        return self.rng.choice([INT, INT, FLOAT, TEXT, BOOL, DATE, TIME])

    def plain(self, depth):
        if self.chance(0.03):
            where = self.rng.choice(["", " where false", " where null = null", " where 1 = 1", " where 1 in (2, null)"])
            kinds = [self.kind() for _ in range(self.rng.choice([1, 2]))]
            return f"select {self.items([self.expression([], kind, 1) for kind in kinds])}{where}", kinds
        source, columns, keys = self.source(depth)
        kinds = [self.kind() for _ in range(self.rng.choice([1, 2, 3]))]
        items = [self.expression(columns, kind) for kind in kinds]
        if self.chance(0.35):
            for _ in range(self.rng.choice([1, 1, 2])):
                text, kind = self.window(columns, keys)
                items.append(text)
                kinds.append(kind)
        if self.chance(0.12) and depth < 2:
            items.append(self.scalar_subquery(columns))
            kinds.append(INT)
        distinct = "distinct " if self.chance(0.12) else ""
        return f"select {distinct}{self.items(items)} from {source}{self.where(columns, depth)}", kinds

    def items(self, items):
        texts, used = [], set()
        for n, item in enumerate(items):
            is_named = item in used or self.chance(0.7)
            used.add(item)
            texts.append(f"{item} {self.rng.choice(['as ', ''])}{self.rng.choice(['v', 'out_', 'w'])}{n}" if is_named else item)
        return ", ".join(texts)

    def grouped(self, depth):
        source, columns, _ = self.source(depth)
        kinds = [self.rng.choice([TEXT, TEXT, INT, BOOL, DATE]) for _ in range(self.rng.choice([0, 1, 1, 1, 2]))]
        keys = [self.expression(columns, kind, self.rng.choice([0, 0, 1])) for kind in kinds]
        is_constant = [not any(name in key for name, _ in columns) for key in keys]
        keys = [self.column(columns, kind) if constant else key for key, kind, constant in zip(keys, kinds, is_constant)]
        keys = [key for key in keys if any(name in key for name, _ in columns)]
        kinds = kinds[: len(keys)] if len(keys) == len(kinds) else [INT for _ in keys]
        if len(keys) != len(is_constant):
            keys, kinds = [], []
        items, out = list(keys), list(kinds)
        found = [self.aggregate(columns, exact=depth > 0) for _ in range(self.rng.choice([1, 1, 2, 3]))]
        items += [text for text, _ in found]
        out += [kind for _, kind in found]
        if self.chance(0.15):
            items.append(f"{self.aggregate_of(columns, INT)} {self.rng.choice(['* 1.0 /', '+', '-'])} {self.aggregate_of(columns, INT)}")
            out.append(FLOAT)
        if keys and self.chance(0.15):
            self.has.add("window")
            text = self.rng.choice([f"sum(count(*)) over ()", f"count(*) * 1.0 / sum(count(*)) over ()", f"rank() over (order by count(*) desc)", f"sum(sum({self.column(columns, INT)})) over (partition by {keys[0]})", f"max(count(*)) over (order by {keys[0]})"])
            items.append(text)
            out.append(FLOAT)
        by = ""
        if keys:
            by = " group by " + self.rng.choice([lambda: ", ".join(keys), lambda: ", ".join(keys), lambda: ", ".join(str(n + 1) for n in range(len(keys)))])()
            if len(keys) == 2 and " over " not in " ".join(items) and self.chance(0.3):
                by = " group by " + self.rng.choice([f"rollup ({keys[0]}, {keys[1]})", f"cube ({keys[0]}, {keys[1]})", f"grouping sets (({keys[0]}), ({keys[1]}), ())"])
        having = ""
        if self.chance(0.4):
            self.has.add("having")
            left = self.aggregate_of(columns, INT)
            having = f" having {left} {self.rng.choice(['>', '>=', '<', '<>', '='])} {self.rng.choice(['0', '1', '2', '3'])}"
            if self.chance(0.2):
                having += f" {self.rng.choice(['and', 'or'])} {self.aggregate_of(columns, INT)} is not null"
        where = self.where(columns, depth)
        return f"select {self.items(items)} from {source}{where}{by}{having}", out

    def aggregate_of(self, columns, kind):
        return self.rng.choice(["count(*)", f"count({self.column(columns, TEXT)})", f"sum({self.column(columns, kind)})", f"max({self.column(columns, kind)})", f"min({self.column(columns, kind)})"])

    def set_operation(self, depth):
        word = self.rng.choice(["union", "union all", "except", "intersect"])
        kinds = [self.kind() for _ in range(self.rng.choice([1, 2]))]
        sides = []
        for _ in range(2):
            source, columns, _ = self.source(depth + 1)
            items = [self.expression(columns, kind, 1) for kind in kinds]
            sides.append(f"select {', '.join(f'{item} as c{n}' for n, item in enumerate(items))} from {source}{self.where(columns, depth + 1)}")
        return f"{sides[0]} {word} {sides[1]}", kinds

    def statement(self):
        """Returns a statement, whether its rows have an order, and what stands in it."""
        self.has, self.n_aliases = set(), 0
        query, kinds = self.select()
        if self.chance(0.15):
            self.has.add("subquery")
            names = ", ".join(f"c{n}" for n in range(len(kinds)))
            keep = self.rng.choice(["", " where c0 is not null", " where c0 = c0"])
            query = f"with part({names}) as ({query}) select {self.rng.choice(['*', names])} from part{keep}"
        is_ordered = False
        if self.chance(0.5) and "rough" not in kinds:
            is_ordered = True
            order = [str(n + 1) + self.rng.choice(["", "", " desc", " nulls first", " desc nulls last"]) for n in range(len(kinds))]
            query += f" order by {', '.join(order)}"
            if self.chance(0.4):
                query += f" limit {self.rng.choice([0, 1, 3, 10])}"
                if self.chance(0.4):
                    query += f" offset {self.rng.choice([0, 1, 2])}"
        elif self.chance(0.15) and " group by " in query and not query.startswith("with") and "rough" not in kinds:
            query += " order by count(*) desc, 1" if " union" not in query and " except" not in query and " intersect" not in query else ""
        if " is null" in query or " join " in query and ("left" in query or "full" in query or "right" in query):
            self.has.add("null")
        return query, is_ordered, set(self.has)


def statements(seed, path):
    """Yields tables, and then statements over them."""
    rng = random.Random(seed)
    while True:
        tables = Tables(rng)
        yield tables
        made = Statements(rng, tables, path)
        for _ in range(40):
            yield made.statement()
