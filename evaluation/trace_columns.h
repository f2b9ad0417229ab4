// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "evaluation/text_file.h"

namespace forcegrid::evaluation {

/// Reads the rows of a trace: CSV whose first line names the columns, in any order.
/// Columns are numbered as in `names`. Everything that is wrong with the file is thrown as a
/// TraceError that names file, line and column.
/// Real-time: no. Threads: one.
class TraceColumns {
 public:
  /// Reads the header.
  /// @param names all columns that the file may have; they outlive this object.
  /// @param required so many of the first must be there.
  /// @param header_form what to write, for messages.
  /// @throws TraceError, also for an empty file; FileError if the file can't be read.
  TraceColumns(const std::string& file, std::span<const std::string_view> names,
               std::size_t required, const std::string& header_form);

  /// Goes to the next row that is not blank. @returns false after the last one.
  bool next();

  bool has(std::size_t column) const { return seen_[column]; }  ///< in the header
  /// The row's field, without blanks at its ends; empty for a column that the file does not have.
  std::string_view field(std::size_t column) const { return fields_[column]; }
  bool empty(std::size_t column) const { return fields_[column].empty(); }
  /// @throws TraceError unless the field is a finite number.
  double number(std::size_t column) const;
  std::optional<double> optional_number(std::size_t column) const;
  /// Three numbers from column `first` on.
  Eigen::Vector3d vector(std::size_t first) const;

  /// @throws TraceError: "FILE, line N: what", or "FILE, line N: column 'c': what".
  [[noreturn]] void refuse(const std::string& what) const;
  [[noreturn]] void refuse(std::size_t column, const std::string& what) const;

 private:
  void read_header(std::string_view line, std::size_t required, const std::string& header_form);
  void read_fields(std::string_view line);

  std::string file_;
  std::span<const std::string_view> names_;
  LineReader lines_;
  std::vector<bool> seen_;
  std::vector<std::size_t> columns_;  ///< column of each field
  std::vector<std::string_view> fields_;
};

/// Text of one row of a trace with `column_count` columns; what is not added is left empty.
class TraceRow {
 public:
  explicit TraceRow(std::size_t column_count) : column_count_(column_count) {}

  void start(std::string_view kind);
  void add(double value);
  void add(const Eigen::Vector3d& values);
  void skip();
  /// The whole row with its end of line.
  const std::string& finish();

 private:
  std::size_t column_count_;
  std::string text_;
  std::size_t fields_ = 0;
};

/// A number as traces write it: the shortest text that reads back as exactly `value`.
std::string number_text(double value);

}  // namespace forcegrid::evaluation
