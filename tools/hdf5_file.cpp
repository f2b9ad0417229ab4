// SPDX-License-Identifier: Apache-2.0
#include "tools/hdf5_file.h"

#include <hdf5.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <functional>
#include <numeric>
#include <string_view>

#include "text/file_kind.h"

namespace forcegrid::tools {
namespace {

constexpr unsigned kDeflate = 1;  // the first level achieves most of the compression
constexpr std::size_t kChunkCache_bytes = 1 << 18;
constexpr std::size_t kChunkCacheSlots = 521;  // a prime, as HDF5 recommends
constexpr double kEvictWritten = 1.0;
// Checksums that fail_with_reason are read again, as a writer may be at work: after 1, 2, 4 ... ns,
// 1 ms in all. The library's default for SWMR is 100 attempts, whose last pauses outlast any user.
constexpr unsigned kReadAttempts = 20;
constexpr double kMostNumbersPerByte = 1100.0;     // deflate packs 1032 bytes into one at most
constexpr std::size_t kLargestAttribute = 60'000;  // HDF5 stores attributes in an object's header

// Any of HDF5's identifiers, closed with it.
class Id {
 public:
  Id(hid_t id, herr_t (*close)(hid_t)) noexcept : id_(id), close_(close) {}
  ~Id() {
    if (id_ >= 0) {
      close_(id_);
    }
  }
  Id(const Id&) = delete;
  Id& operator=(const Id&) = delete;
  operator hid_t() const noexcept { return id_; }

 private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

// Stops HDF5 from printing its errors, which must be set per thread; here they become exceptions.
// Also stops its clean-up at exit, which crashes after a failed write.
void be_quiet() {
  static const herr_t once = H5dont_atexit();
  static_cast<void>(once);
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

// HDF5's own words speak of its inside ("address overflowed") and are of no use to people. Only
// what the system has said, which HDF5 quotes, is taken: "..., error message = 'No space left on
// device', ...".
herr_t take_system_error(unsigned, const H5E_error2_t* error, void* text) {
  constexpr std::string_view kBefore = "error message = '";
  const std::string_view words = error->desc != nullptr ? error->desc : "";
  const std::size_t quoted = words.find(kBefore);
  if (quoted != std::string_view::npos) {
    const std::string_view rest = words.substr(quoted + kBefore.size());
    *static_cast<std::string*>(text) = rest.substr(0, rest.find('\''));
  }
  return 0;
}

[[noreturn]] void fail_with_reason(const std::string& file, const std::string& what) {
  std::string reason;
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_DOWNWARD, take_system_error, &reason);
  throw Hdf5Error(file + ": " + what + (reason.empty() ? "" : " (" + reason + ")"));
}

template <typename Result>
Result checked(Result result, const std::string& file, const std::string& what) {
  if (result < 0) {
    fail_with_reason(file, what);
  }
  return result;
}

hid_t file_type(Hdf5Type type) {
  switch (type) {
    case Hdf5Type::kFloat64:
      return H5T_IEEE_F64LE;
    case Hdf5Type::kFloat32:
      return H5T_IEEE_F32LE;
    case Hdf5Type::kInt32:
      return H5T_STD_I32LE;
    case Hdf5Type::kUint8:
      return H5T_STD_U8LE;
    case Hdf5Type::kUint16:
      return H5T_STD_U16LE;
    case Hdf5Type::kUint32:
      return H5T_STD_U32LE;
    case Hdf5Type::kUint64:
      return H5T_STD_U64LE;
  }
  return H5T_IEEE_F64LE;
}

void write_attribute(hid_t object, const std::string& file, const std::string& name,
                     const std::string& text) {
  if (text.size() > kLargestAttribute) {
    throw Hdf5Error(file + ": attribute " + name + " has " + std::to_string(text.size()) +
                    " bytes, more than HDF5 stores in one attribute");
  }
  const Id type(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type, std::max<std::size_t>(text.size(), 1));
  H5Tset_cset(type, H5T_CSET_UTF8);
  H5Tset_strpad(type, H5T_STR_NULLPAD);
  const Id space(H5Screate(H5S_SCALAR), H5Sclose);
  const Id attribute(H5Acreate2(object, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT),
                     H5Aclose);
  const std::string padded = text.empty() ? std::string(1, '\0') : text;
  checked(attribute >= 0 ? H5Awrite(attribute, type, padded.data()) : -1, file,
          "attribute " + name + " can't be written");
}

// Of a file or data set; empty if there is none.
std::string read_attribute(hid_t object, const std::string& file, const std::string& name) {
  const htri_t exists = H5Aexists(object, name.c_str());
  checked(exists, file, "damaged: its attributes can't be read");
  if (exists == 0) {
    return "";
  }
  const Id attribute(H5Aopen(object, name.c_str(), H5P_DEFAULT), H5Aclose);
  const Id type(H5Aget_type(attribute), H5Tclose);
  if (attribute < 0 || H5Tget_class(type) != H5T_STRING || H5Tis_variable_str(type) > 0) {
    fail_with_reason(file, "damaged: attribute " + name + " is not a text of fixed length");
  }
  const std::size_t length = H5Tget_size(type);
  if (length > kLargestAttribute) {
    throw Hdf5Error(file + ": damaged: attribute " + name + " claims " + std::to_string(length) +
                    " bytes");
  }
  std::string text(length, '\0');
  checked(H5Aread(attribute, type, text.data()), file,
          "damaged: attribute " + name + " can't be read");
  text.resize(std::strlen(text.c_str()));
  return text;
}

std::vector<std::string> names_in(hid_t object, const std::string& file, const std::string& group) {
  std::vector<std::string> names;
  const auto take = [](hid_t, const char* name, const H5L_info_t*, void* list) -> herr_t {
    static_cast<std::vector<std::string>*>(list)->emplace_back(name);
    return 0;
  };
  checked(H5Literate_by_name(object, group.c_str(), H5_INDEX_NAME, H5_ITER_INC, nullptr, take,
                             &names, H5P_DEFAULT),
          file, "damaged: group " + group + " can't be read");
  return names;
}

std::vector<hsize_t> shape(const Hdf5Column& column, std::uint64_t rows) {
  std::vector<hsize_t> dimensions{rows};
  dimensions.insert(dimensions.end(), column.row_shape.begin(), column.row_shape.end());
  return dimensions;
}

hid_t create_dataset(hid_t file_id, const std::string& file, const Hdf5Column& column,
                     std::uint64_t rows_per_chunk) {
  const std::vector<hsize_t> now = shape(column, 0);
  const std::vector<hsize_t> most = shape(column, H5S_UNLIMITED);
  const std::vector<hsize_t> chunk = shape(column, rows_per_chunk);
  const int rank = static_cast<int>(now.size());
  const Id space(H5Screate_simple(rank, now.data(), most.data()), H5Sclose);
  const Id creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  H5Pset_chunk(creation, rank, chunk.data());
  H5Pset_shuffle(creation);
  H5Pset_deflate(creation, kDeflate);
  const Id access(H5Pcreate(H5P_DATASET_ACCESS), H5Pclose);
  H5Pset_chunk_cache(access, kChunkCacheSlots, kChunkCache_bytes, kEvictWritten);
  const Id links(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
  H5Pset_create_intermediate_group(links, 1);
  const hid_t dataset = H5Dcreate2(file_id, column.name.c_str(), file_type(column.type), space,
                                   links, creation, access);
  checked(dataset, file, column.name + " can't be made");
  write_attribute(dataset, file, "meaning", column.meaning);
  return dataset;
}

void append_rows(hid_t dataset, const std::string& file, const Hdf5Column& column,
                 std::uint64_t rows_before, const std::vector<double>& numbers) {
  const std::uint64_t added = numbers.size() / column.numbers_per_row();
  const std::vector<hsize_t> all = shape(column, rows_before + added);
  const std::vector<hsize_t> block = shape(column, added);
  std::vector<hsize_t> start(block.size(), 0);
  start.front() = rows_before;
  const std::string what = column.name + " can't be written";
  checked(H5Dset_extent(dataset, all.data()), file, what);
  const Id there(H5Dget_space(dataset), H5Sclose);
  checked(H5Sselect_hyperslab(there, H5S_SELECT_SET, start.data(), nullptr, block.data(), nullptr),
          file, what);
  const Id here(H5Screate_simple(static_cast<int>(block.size()), block.data(), nullptr), H5Sclose);
  checked(H5Dwrite(dataset, H5T_NATIVE_DOUBLE, here, there, H5P_DEFAULT, numbers.data()), file,
          what);
}

}  // namespace

std::string hdf5_version() {
  be_quiet();  // any first call of the library settles what it does at exit
  unsigned major = 0;
  unsigned minor = 0;
  unsigned release = 0;
  H5get_libversion(&major, &minor, &release);
  return std::to_string(major) + "." + std::to_string(minor) + "." + std::to_string(release);
}

std::size_t Hdf5Column::numbers_per_row() const noexcept {
  return std::accumulate(row_shape.begin(), row_shape.end(), std::size_t{1}, std::multiplies<>());
}

struct Hdf5Writer::Column {
  Hdf5Column description;
  hid_t dataset = -1;
  std::uint64_t rows = 0;
};

Hdf5Writer::Hdf5Writer(const std::string& file) : file_(file) {
  be_quiet();
  const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_libver_bounds(access, H5F_LIBVER_V110, H5F_LIBVER_V110);
  errno = 0;
  const hid_t id = H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access);
  if (id < 0) {
    const std::string reason = errno != 0 ? std::strerror(errno) : "HDF5 refuses it";
    throw Hdf5Error(file + ": can't be created (" + reason +
                    "); name a file in a folder that exists and is writable");
  }
  id_ = id;
}

Hdf5Writer::~Hdf5Writer() {
  try {
    close();
  } catch (const Hdf5Error&) {
    // Callers that need the error call close().
  }
}

void Hdf5Writer::add_attribute(const std::string& name, const std::string& text) {
  write_attribute(id_, file_, name, text);
}

std::size_t Hdf5Writer::add_column(const Hdf5Column& column, std::uint64_t rows_per_chunk) {
  Column made;
  made.description = column;
  made.dataset = create_dataset(id_, file_, column, rows_per_chunk);
  columns_.push_back(made);
  return columns_.size() - 1;
}

void Hdf5Writer::begin() {
  checked(H5Fflush(id_, H5F_SCOPE_GLOBAL), file_, "can't be written");
  checked(H5Fstart_swmr_write(id_), file_, "can't be written safely");
}

void Hdf5Writer::append(std::size_t column, const std::vector<double>& numbers) {
  Column& to = columns_.at(column);
  if (numbers.empty()) {
    return;
  }
  be_quiet();
  failed_ = true;
  append_rows(to.dataset, file_, to.description, to.rows, numbers);
  failed_ = false;
  to.rows += numbers.size() / to.description.numbers_per_row();
}

void Hdf5Writer::flush() {
  be_quiet();
  failed_ = true;
  for (const Column& column : columns_) {
    checked(H5Dflush(column.dataset), file_, column.description.name + " can't be written");
  }
  failed_ = false;
}

void Hdf5Writer::close() {
  if (id_ < 0) {
    return;
  }
  if (failed_) {
    // Left as after a kill, complete up to the last flush: closing would write again.
    columns_.clear();
    id_ = -1;
    return;
  }
  be_quiet();
  for (const Column& column : columns_) {
    failed_ = H5Dclose(column.dataset) < 0 || failed_;
  }
  columns_.clear();
  failed_ = H5Fclose(id_) < 0 || failed_;
  id_ = -1;
  if (failed_) {
    fail_with_reason(file_, "can't be completed");
  }
}

Hdf5Reader::Hdf5Reader(const std::string& file) : file_(file) {
  be_quiet();
  const std::string why_not = text::why_no_file(file);
  if (!why_not.empty()) {
    throw Hdf5Error(file + ": " + why_not + "; name a recording of 'forcegrid record'");
  }
  if (::access(file.c_str(), R_OK) != 0) {
    throw Hdf5Error(file + ": can't be read (" + std::strerror(errno) + ")");
  }
  std::error_code error;
  size_bytes_ = std::filesystem::file_size(file, error);
  if (H5Fis_hdf5(file.c_str()) <= 0) {
    throw Hdf5Error(file +
                    ": not an HDF5 file, or its first bytes are damaged; name a recording of "
                    "'forcegrid record'");
  }
  const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_metadata_read_attempts(access, kReadAttempts);
  id_ = H5Fopen(file.c_str(), H5F_ACC_RDONLY | H5F_ACC_SWMR_READ, access);
  if (id_ < 0) {
    fail_with_reason(file, "damaged: its superblock or root group can't be read");
  }
}

Hdf5Reader::~Hdf5Reader() { H5Fclose(id_); }

bool Hdf5Reader::has(const std::string& name) const {
  std::size_t at = 0;  // HDF5 requires a check of each group on the path
  while ((at = name.find('/', at + 1)) != std::string::npos) {
    if (H5Lexists(id_, name.substr(0, at).c_str(), H5P_DEFAULT) <= 0) {
      return false;
    }
  }
  return H5Lexists(id_, name.c_str(), H5P_DEFAULT) > 0;
}

std::string Hdf5Reader::attribute(const std::string& name) const {
  return read_attribute(id_, file_, name);
}

std::vector<std::string> Hdf5Reader::columns() const {
  std::vector<std::string> names;
  const auto is = [&](const std::string& name, H5I_type_t type) {
    const Id object(H5Oopen(id_, name.c_str(), H5P_DEFAULT), H5Oclose);
    return object >= 0 && H5Iget_type(object) == type;
  };
  for (const std::string& group : names_in(id_, file_, "/")) {
    if (is("/" + group, H5I_GROUP)) {
      for (const std::string& name : names_in(id_, file_, "/" + group)) {
        if (is("/" + group + "/" + name, H5I_DATASET)) {
          names.push_back("/" + group + "/" + name);
        }
      }
    }
  }
  return names;
}

Hdf5Column Hdf5Reader::column(const std::string& name) const {
  const Id dataset(H5Dopen2(id_, name.c_str(), H5P_DEFAULT), H5Dclose);
  const std::vector<std::uint64_t> shape = shape_of(dataset, name);
  Hdf5Column column{name, Hdf5Type::kFloat64, {shape.begin() + 1, shape.end()}, ""};
  const Id type(H5Dget_type(dataset), H5Tclose);
  for (const Hdf5Type known : {Hdf5Type::kFloat32, Hdf5Type::kInt32, Hdf5Type::kUint8,
                               Hdf5Type::kUint16, Hdf5Type::kUint32, Hdf5Type::kUint64}) {
    if (H5Tequal(type, file_type(known)) > 0) {
      column.type = known;
    }
  }
  column.meaning = read_attribute(dataset, file_, "meaning");
  return column;
}

std::vector<std::uint64_t> Hdf5Reader::shape_of(std::int64_t dataset,
                                                const std::string& column) const {
  const std::string what = "damaged: " + column + " can't be opened, or is missing";
  const Id space(checked(dataset >= 0 ? H5Dget_space(dataset) : -1, file_, what), H5Sclose);
  const int rank = checked(H5Sget_simple_extent_ndims(space), file_, what);
  std::vector<hsize_t> size(static_cast<std::size_t>(rank), 0);
  checked(H5Sget_simple_extent_dims(space, size.data(), nullptr), file_, what);
  const double numbers = std::accumulate(size.begin(), size.end(), 1.0, [](double a, hsize_t b) {
    return a * static_cast<double>(b);
  });
  if (rank == 0 || numbers > kMostNumbersPerByte * static_cast<double>(size_bytes_)) {
    throw Hdf5Error(file_ + ": damaged: " + column + " claims more numbers than the file can hold");
  }
  return {size.begin(), size.end()};
}

std::uint64_t Hdf5Reader::rows(const std::string& column) const {
  const Id dataset(H5Dopen2(id_, column.c_str(), H5P_DEFAULT), H5Dclose);
  return shape_of(dataset, column).front();
}

std::vector<double> Hdf5Reader::numbers(const std::string& column, std::uint64_t rows,
                                        std::uint64_t first) const {
  const Id dataset(H5Dopen2(id_, column.c_str(), H5P_DEFAULT), H5Dclose);
  const std::vector<std::uint64_t> shape = shape_of(dataset, column);
  std::vector<hsize_t> size(shape.begin(), shape.end());
  if (first > size.front() || size.front() - first < rows) {
    throw Hdf5Error(file_ + ": damaged: " + column + " has fewer rows than its neighbours");
  }
  size.front() = rows;
  std::vector<double> numbers(std::accumulate(size.begin(), size.end(), std::size_t{1},
                                              [](std::size_t a, hsize_t b) { return a * b; }));
  if (numbers.empty()) {
    return numbers;
  }
  const std::string what = "damaged: " + column + " can't be read";
  std::vector<hsize_t> start(size.size(), 0);
  start.front() = first;
  const Id there(checked(H5Dget_space(dataset), file_, what), H5Sclose);
  checked(H5Sselect_hyperslab(there, H5S_SELECT_SET, start.data(), nullptr, size.data(), nullptr),
          file_, what);
  const Id here(H5Screate_simple(static_cast<int>(size.size()), size.data(), nullptr), H5Sclose);
  checked(H5Dread(dataset, H5T_NATIVE_DOUBLE, here, there, H5P_DEFAULT, numbers.data()), file_,
          what);
  return numbers;
}

void add_to_hdf5(const std::string& file,
                 const std::vector<std::pair<std::string, std::string>>& attributes,
                 const std::vector<std::pair<Hdf5Column, std::vector<double>>>& columns) {
  be_quiet();
  const Id id(H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT), H5Fclose);
  checked(static_cast<hid_t>(id), file, "can't be opened again");
  for (const auto& [name, text] : attributes) {
    write_attribute(id, file, name, text);
  }
  for (const auto& [column, numbers] : columns) {
    const std::uint64_t rows = numbers.size() / column.numbers_per_row();
    const Id dataset(create_dataset(id, file, column, std::max<std::uint64_t>(rows, 1)), H5Dclose);
    append_rows(dataset, file, column, 0, numbers);
  }
  checked(H5Fflush(id, H5F_SCOPE_GLOBAL), file, "can't be completed");
}

}  // namespace forcegrid::tools
