"""Tables of a lake reach Python as the program answers them."""

import importlib.util
import json
import unittest

import numpy as np

import lab
import pipeline


class Lakes(unittest.TestCase):
    def setUp(self):
        self.project = lab.done()
        self.lake = pipeline.Lake(self.project / "data/lake")

    def test_an_answer_is_the_programs(self):
        sql = "select object, mass_kg, count(*) over () as n from objects order by object"
        asked = lab.run("query", sql, "--format", "json", cwd=self.project)
        expected = [json.loads(line) for line in asked.stdout.splitlines()]
        rows = self.lake.query(sql)
        self.assertEqual(len(rows), len(expected))
        self.assertEqual(rows.column_names, ["object", "mass_kg", "n"])
        for name in ["mass_kg", "n"]:
            np.testing.assert_array_equal(rows.column(name), [row[name] for row in expected])

    def test_other_libraries_take_an_answer_over(self):
        rows = self.lake.query("select object, mass_kg from objects order by object")
        for library, take in [("polars", "DataFrame"), ("pyarrow", "table")]:
            if importlib.util.find_spec(library) is None:
                continue
            table = getattr(importlib.import_module(library), take)(rows)
            np.testing.assert_array_equal(np.array(table["mass_kg"]), rows.column("mass_kg"))
            self.assertEqual(len(table["object"]), len(rows))

    def test_a_run_is_named_as_the_program_names_it(self):
        runs = self.lake.query("select run from runs")
        self.assertGreaterEqual(len(runs), 1)
        with self.assertRaisesRegex(pipeline.Error, "no run"):
            self.lake.query("select * from objects", run="none")

    def test_what_cannot_be_answered_is_an_error_with_a_hint(self):
        for sql, what in [
            ("select * from object", "object"),
            ("select", "SQL"),
            ("select mass from objects", "mass"),
        ]:
            with self.assertRaisesRegex(pipeline.Error, what) as raised:
                self.lake.query(sql)
            self.assertTrue(raised.exception.hint, sql)
        with self.assertRaisesRegex(pipeline.Error, "nowhere"):
            pipeline.Lake("nowhere").query("select * from objects")
        rows = self.lake.query("select object, points_m from objects")
        with self.assertRaisesRegex(pipeline.Error, "no column `mass`"):
            rows.column("mass")
        with self.assertRaisesRegex(pipeline.Error, "List"):
            rows.column("points_m")

    def test_columns_are_arrays_of_numbers_truths_and_texts(self):
        rows = self.lake.query("select 1 as n, true as t, 'a' as s, cast(null as double) as nothing")
        self.assertEqual(rows.column("n").dtype, float)
        self.assertEqual(rows.column("t").tolist(), [True])
        self.assertEqual(rows.column("s").tolist(), ["a"])
        self.assertNotEqual(rows.column("nothing")[0], rows.column("nothing")[0])
        none = self.lake.query("select object from objects where object = 'nothing'")
        self.assertEqual(none.column("object").tolist(), [])


if __name__ == "__main__":
    unittest.main()
