// SPDX-License-Identifier: Apache-2.0
#include "driver/libusb_transport.h"

#include <libusb.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include "driver/device.h"
#include "driver/node_users.h"

namespace forcegrid::driver {
namespace {

constexpr std::size_t kInTransfers = 2;  // one is always pending while the other is read
constexpr rt::Duration kCancelTimeout = std::chrono::milliseconds(200);
constexpr int kMaxPorts = 7;  // hubs can't be deeper

std::string words(int error) {
  return std::string(libusb_strerror(static_cast<libusb_error>(error))) + " (" +
         libusb_error_name(error) + ")";
}

[[noreturn]] void refuse(const DeviceUrl& url, const std::string& problem) {
  throw DeviceError("device '" + url.text + "': " + problem);
}

class Context {
 public:
  Context() {
    if (const int error = libusb_init(&context_); error != 0) {
      throw DeviceError("libusb: " + words(error) +
                        "; check that /dev/bus/usb is there and readable");
    }
  }
  ~Context() { libusb_exit(context_); }
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;
  libusb_context* get() const noexcept { return context_; }

 private:
  libusb_context* context_ = nullptr;
};

using Handle = std::unique_ptr<libusb_device_handle, decltype(&libusb_close)>;

/// "1-2.4": the USB port as sysfs names it.
std::string port_path_of(libusb_device* device) {
  std::array<std::uint8_t, kMaxPorts> ports{};
  const int depth = libusb_get_port_numbers(device, ports.data(), kMaxPorts);
  std::string path = std::to_string(libusb_get_bus_number(device));
  for (int i = 0; i < depth; ++i) {
    path.append(i == 0 ? "-" : ".").append(std::to_string(ports[static_cast<std::size_t>(i)]));
  }
  return path;
}

/// "/dev/bus/usb/001/004"
std::string node_of(libusb_device* device) {
  char node[40];
  std::snprintf(node, sizeof node, "/dev/bus/usb/%03u/%03u",
                static_cast<unsigned>(libusb_get_bus_number(device)),
                static_cast<unsigned>(libusb_get_device_address(device)));
  return node;
}

std::string string_of(libusb_device_handle* handle, std::uint8_t number) {
  std::array<unsigned char, 256> text{};
  if (number == 0) {
    return "";
  }
  const int size = libusb_get_string_descriptor_ascii(handle, number, text.data(),
                                                      static_cast<int>(text.size()));
  return size > 0 ? std::string(text.begin(), text.begin() + size) : "";
}

std::string remedy_for_libusb(int error) {
  switch (error) {
    case LIBUSB_ERROR_ACCESS:
      return "install the udev rule (make install-udev), then plug the device in again";
    case LIBUSB_ERROR_BUSY:
      return "end the other program that uses the device";
    case LIBUSB_ERROR_NO_DEVICE:
      return "plug the device in again";
    default:
      return "plug the device in again, and look into the kernel's log";
  }
}

struct Candidate {
  libusb_device* device = nullptr;
  libusb_device_descriptor descriptor{};
  Handle handle{nullptr, &libusb_close};
  int open_error = 0;
  std::string port_path;
  std::string serial;
};

/// The devices of these numbers that `url` does not exclude, opened where that is permitted.
std::vector<Candidate> candidates(const DeviceUrl& url, libusb_device** list, ssize_t count,
                                  std::uint16_t vendor_id, std::uint16_t product_id) {
  std::vector<Candidate> found;
  for (ssize_t i = 0; i < count; ++i) {
    Candidate candidate;
    candidate.device = list[i];
    if (libusb_get_device_descriptor(list[i], &candidate.descriptor) != 0 ||
        candidate.descriptor.idVendor != vendor_id ||
        candidate.descriptor.idProduct != product_id) {
      continue;
    }
    candidate.port_path = port_path_of(list[i]);
    if (!url.port_path.empty() && url.port_path != candidate.port_path) {
      continue;
    }
    libusb_device_handle* handle = nullptr;
    candidate.open_error = libusb_open(list[i], &handle);
    candidate.handle.reset(handle);
    if (handle != nullptr) {
      candidate.serial = string_of(handle, candidate.descriptor.iSerialNumber);
      if (!url.serial.empty() && url.serial != candidate.serial) {
        continue;
      }
    }
    found.push_back(std::move(candidate));
  }
  return found;
}

struct BulkInterface {
  int number = -1;
  std::uint8_t in_endpoint = 0;
  std::uint8_t out_endpoint = 0;
};

BulkInterface find_bulk_interface(libusb_device* device) {
  libusb_config_descriptor* configuration = nullptr;
  if (libusb_get_active_config_descriptor(device, &configuration) != 0) {
    return {};
  }
  const std::unique_ptr<libusb_config_descriptor, decltype(&libusb_free_config_descriptor)> owner(
      configuration, &libusb_free_config_descriptor);
  for (int i = 0; i < configuration->bNumInterfaces; ++i) {
    if (configuration->interface[i].num_altsetting < 1) {
      continue;
    }
    const libusb_interface_descriptor& interface = configuration->interface[i].altsetting[0];
    BulkInterface found{.number = interface.bInterfaceNumber};
    for (int e = 0; e < interface.bNumEndpoints; ++e) {
      const libusb_endpoint_descriptor& endpoint = interface.endpoint[e];
      if ((endpoint.bmAttributes & LIBUSB_TRANSFER_TYPE_MASK) != LIBUSB_TRANSFER_TYPE_BULK) {
        continue;
      }
      ((endpoint.bEndpointAddress & LIBUSB_ENDPOINT_IN) != 0 ? found.in_endpoint
                                                             : found.out_endpoint) =
          endpoint.bEndpointAddress;
    }
    if (interface.bInterfaceClass == LIBUSB_CLASS_VENDOR_SPEC && found.in_endpoint != 0 &&
        found.out_endpoint != 0) {
      return found;
    }
  }
  return {};
}

class LibusbTransport final : public BulkTransport {
 public:
  LibusbTransport(const DeviceUrl& url, std::uint16_t vendor_id, std::uint16_t product_id)
      : url_(url), handle_(nullptr, &libusb_close) {
    open(vendor_id, product_id);
    try {
      claim_and_allocate();
      for (Transfer& in : in_) {
        if (!submit_in(in)) {
          throw DeviceError(failure_);
        }
      }
    } catch (...) {
      close();
      throw;
    }
  }

  ~LibusbTransport() override { close(); }

  const TransportIdentity& identity() const noexcept override { return identity_; }
  const std::vector<std::uint8_t>& report_descriptor() const noexcept override { return none_; }
  const std::string& failure() const noexcept override { return failure_; }

  ReadResult read(std::span<std::uint8_t> buffer, rt::Duration timeout) noexcept override {
    const rt::TimePoint deadline = rt::Clock::now() + std::max(timeout, rt::Duration::zero());
    // Packets that arrived before a failure are still handed out.
    if (status_ == TransportStatus::kOk) {
      handle_events(deadline, [this] { return oldest_in() != nullptr; });
    }
    Transfer* const in = oldest_in();
    if (in == nullptr) {
      return {.status = status_ == TransportStatus::kOk ? TransportStatus::kTimeout : status_};
    }
    in->done = false;
    if (in->transfer->status != LIBUSB_TRANSFER_COMPLETED) {
      fail_transfer(in->transfer->status, "no more data");
      return {.status = status_};
    }
    const ReadResult result{.status = TransportStatus::kOk,
                            .bytes = static_cast<std::size_t>(in->transfer->actual_length),
                            .arrived = in->completed};
    std::memcpy(buffer.data(), in->buffer.data(), std::min(buffer.size(), result.bytes));
    if (status_ == TransportStatus::kOk) {
      static_cast<void>(submit_in(*in));  // a failure shows at the next call
    }
    return result;
  }

  bool can_wait() const noexcept override { return false; }
  WaitEnd wait(int, rt::Duration) noexcept override { return WaitEnd::kTimeout; }

  WriteResult write(std::span<const std::uint8_t> bytes, rt::Duration timeout) noexcept override {
    const bool failed_before = status_ != TransportStatus::kOk;
    // An IN that failed leaves the way to the motors open: a last zero still goes out.
    if (failed_before && (status_ != TransportStatus::kProtocol || !out_works_)) {
      return {.status = status_};
    }
    if (bytes.size() > kMaxBulkBytes) {
      fail(TransportStatus::kProtocol, "a packet of more than 64 bytes was to be sent");
      return {.status = status_};
    }
    std::memcpy(out_.buffer.data(), bytes.data(), bytes.size());
    libusb_fill_bulk_transfer(out_.transfer, handle_.get(), interface_.out_endpoint,
                              out_.buffer.data(), static_cast<int>(bytes.size()), &on_done, &out_,
                              0);
    const TransportStatus status = run(out_, timeout, "it does not take data");
    if (!failed_before && status_ != TransportStatus::kOk) {
      out_works_ = false;
    }
    return {.status = status, .completed = out_.completed};
  }

  TransportStatus control_out(const ControlRequest& request,
                              rt::Duration timeout) noexcept override {
    if (status_ != TransportStatus::kOk) {
      return status_;
    }
    libusb_fill_control_setup(control_.buffer.data(), request.request_type, request.request,
                              request.value, request.index, 0);
    libusb_fill_control_transfer(control_.transfer, handle_.get(), control_.buffer.data(), &on_done,
                                 &control_, 0);
    return run(control_, timeout, "it refuses a control request");
  }

  void close() noexcept override {
    if (handle_ == nullptr) {
      return;
    }
    cancel_all();
    bool any_active = false;
    for (Transfer* transfer : all()) {
      any_active = any_active || transfer->active;
      transfer->done = false;  // a cancelled one is nothing to read
      // libusb still owns one that did not end; freeing it would be worse than losing it.
      if (transfer->transfer != nullptr && !transfer->active) {
        libusb_free_transfer(transfer->transfer);
        transfer->transfer = nullptr;
      }
    }
    if (claimed_) {
      static_cast<void>(libusb_release_interface(handle_.get(), interface_.number));
      claimed_ = false;
    }
    if (any_active) {
      static_cast<void>(handle_.release());
    } else {
      handle_.reset();
    }
    if (status_ == TransportStatus::kOk) {
      status_ = TransportStatus::kDisconnected;
      failure_ = "device '" + url_.text + "': closed; open it again";
    }
  }

 private:
  /// One transfer, allocated once, with its buffer.
  struct Transfer {
    libusb_transfer* transfer = nullptr;
    std::array<unsigned char, std::max<std::size_t>(kMaxBulkBytes, LIBUSB_CONTROL_SETUP_SIZE)>
        buffer{};
    bool active = false;  ///< libusb has it
    bool done = false;    ///< it has ended and nobody has looked at it yet
    std::uint64_t order = 0;
    rt::TimePoint completed{};
    LibusbTransport* owner = nullptr;
  };

  std::array<Transfer*, kInTransfers + 2> all() noexcept {
    return {&in_[0], &in_[1], &out_, &control_};
  }

  // Called from libusb_handle_events, so on the thread that uses the transport.
  static void LIBUSB_CALL on_done(libusb_transfer* transfer) {
    auto* const self = static_cast<Transfer*>(transfer->user_data);
    self->active = false;
    self->done = true;
    self->order = ++self->owner->ended_;
    self->completed = rt::Clock::now();
  }

  void open(std::uint16_t vendor_id, std::uint16_t product_id) {
    libusb_device** list = nullptr;
    const ssize_t count = libusb_get_device_list(context_.get(), &list);
    if (count < 0) {
      refuse(url_, "list of USB devices: " + words(static_cast<int>(count)) +
                       "; check that /dev/bus/usb is there");
    }
    const auto free_list = [](libusb_device** devices) { libusb_free_device_list(devices, 1); };
    const std::unique_ptr<libusb_device*, decltype(free_list)> owner(list, free_list);
    std::vector<Candidate> found = candidates(url_, list, count, vendor_id, product_id);
    if (found.empty()) {
      refuse(url_, "no such device is attached; plug it in and switch its power on");
    }
    if (found.size() > 1) {
      std::string names;
      for (const Candidate& each : found) {
        names.append("\n  falcon:path=").append(each.port_path);
        if (!each.serial.empty()) {
          names.append("   or falcon:").append(each.serial);
        }
      }
      refuse(url_, std::to_string(found.size()) + " devices fit; name one:" + names);
    }
    Candidate& candidate = found.front();
    if (candidate.handle == nullptr) {
      refuse(url_, "open: " + words(candidate.open_error) + "; " +
                       remedy_for_libusb(candidate.open_error));
    }
    interface_ = find_bulk_interface(candidate.device);
    if (interface_.number < 0) {
      refuse(url_,
             "it has no vendor-specific interface with a bulk endpoint each way; this is not a "
             "device of the profile");
    }
    handle_ = std::move(candidate.handle);
    identity_ = {vendor_id, product_id,
                 string_of(handle_.get(), candidate.descriptor.iManufacturer),
                 string_of(handle_.get(), candidate.descriptor.iProduct), candidate.serial};
  }

  void claim_and_allocate() {
    // A system without the means says so, and then there is no kernel driver to detach either.
    static_cast<void>(libusb_set_auto_detach_kernel_driver(handle_.get(), 1));
    if (const int error = libusb_claim_interface(handle_.get(), interface_.number); error != 0) {
      const std::string node = node_of(libusb_get_device(handle_.get()));
      const std::vector<NodeUser> users = users_of_node(node, node).users;
      const std::string claim = "claim its interface: " + words(error) + "; ";
      if (error == LIBUSB_ERROR_BUSY && !users.empty()) {
        throw DeviceInUse("device '" + url_.text + "': " + claim + "it is in use by " +
                          names_of(users) + "; end it (" + command_that_ends(users) + ")");
      }
      refuse(url_, claim + remedy_for_libusb(error));
    }
    claimed_ = true;
    for (Transfer* transfer : all()) {
      transfer->owner = this;
      transfer->transfer = libusb_alloc_transfer(0);
      if (transfer->transfer == nullptr) {
        refuse(url_, "no memory for USB transfers; end other programs");
      }
    }
    for (Transfer& in : in_) {
      libusb_fill_bulk_transfer(in.transfer, handle_.get(), interface_.in_endpoint,
                                in.buffer.data(), static_cast<int>(kMaxBulkBytes), &on_done, &in,
                                0);
    }
  }

  void fail(TransportStatus status, const std::string& problem) {
    if (status_ != TransportStatus::kOk) {
      return;  // the first reason is the one that matters
    }
    status_ = status;
    failure_ = "device '" + url_.text + "': " + problem +
               (status == TransportStatus::kDisconnected
                    ? "; check the cable and plug it in again"
                    : "; plug it in again, and check that it is the device of the profile");
  }

  void fail_transfer(libusb_transfer_status status, const std::string& what) {
    switch (status) {
      case LIBUSB_TRANSFER_STALL:
        fail(TransportStatus::kProtocol, what + ": the endpoint stalled");
        break;
      case LIBUSB_TRANSFER_OVERFLOW:
        fail(TransportStatus::kProtocol, what + ": it sent more than was asked for");
        break;
      case LIBUSB_TRANSFER_NO_DEVICE:
        fail(TransportStatus::kDisconnected, what + ": it was unplugged");
        break;
      default:
        // A device on its way out shows bus errors before the kernel says that it is gone.
        fail(TransportStatus::kDisconnected,
             what + ": bus error (transfer status " + std::to_string(status) + ")");
    }
  }

  bool submit(Transfer& transfer, const char* what) {
    transfer.done = false;
    const int error = libusb_submit_transfer(transfer.transfer);
    if (error != 0) {
      fail(error == LIBUSB_ERROR_NO_DEVICE || error == LIBUSB_ERROR_IO
               ? TransportStatus::kDisconnected
               : TransportStatus::kProtocol,
           std::string(what) + ": " + words(error));
      return false;
    }
    transfer.active = true;
    return true;
  }

  bool submit_in(Transfer& in) { return submit(in, "no more data"); }

  Transfer* oldest_in() noexcept {
    Transfer* oldest = nullptr;
    for (Transfer& in : in_) {
      if (in.done && (oldest == nullptr || in.order < oldest->order)) {
        oldest = &in;
      }
    }
    return oldest;
  }

  /// Lets libusb work until `done()`, a failure, or `deadline`; once at least.
  template <typename Done>
  void handle_events(rt::TimePoint deadline, Done done) noexcept {
    for (bool looked = false;; looked = true) {
      if (done() || (looked && rt::Clock::now() >= deadline)) {
        return;
      }
      const auto left = std::max(deadline - rt::Clock::now(), rt::Duration::zero());
      const auto whole = std::chrono::duration_cast<std::chrono::seconds>(left);
      timeval time{.tv_sec = whole.count(),
                   .tv_usec = static_cast<long>(
                       std::chrono::ceil<std::chrono::microseconds>(left - whole).count())};
      if (time.tv_usec >= 1'000'000) {
        time = {.tv_sec = whole.count() + 1, .tv_usec = 0};
      }
      const int error = libusb_handle_events_timeout_completed(context_.get(), &time, nullptr);
      if (error != 0 && error != LIBUSB_ERROR_INTERRUPTED && error != LIBUSB_ERROR_TIMEOUT) {
        fail(TransportStatus::kDisconnected, "waiting for it: " + words(error));
        return;
      }
    }
  }

  /// Submits one transfer and waits until it has ended; at the time-out it is cancelled.
  TransportStatus run(Transfer& transfer, rt::Duration timeout, const char* what) noexcept {
    if (!submit(transfer, what)) {
      return status_;
    }
    handle_events(rt::Clock::now() + std::max(timeout, rt::Duration::zero()),
                  [&] { return !transfer.active; });
    if (transfer.active) {
      static_cast<void>(libusb_cancel_transfer(transfer.transfer));
      handle_events(rt::Clock::now() + kCancelTimeout, [&] { return !transfer.active; });
      if (transfer.active) {
        fail(TransportStatus::kDisconnected, std::string(what) + ", and it can't be withdrawn");
        return status_;
      }
    }
    transfer.done = false;
    if (transfer.transfer->status == LIBUSB_TRANSFER_CANCELLED) {
      return TransportStatus::kTimeout;
    }
    if (transfer.transfer->status != LIBUSB_TRANSFER_COMPLETED) {
      fail_transfer(transfer.transfer->status, what);
    }
    return status_;
  }

  void cancel_all() noexcept {
    const auto none_active = [this] {
      const auto transfers = all();
      return std::none_of(transfers.begin(), transfers.end(),
                          [](const Transfer* transfer) { return transfer->active; });
    };
    for (Transfer* transfer : all()) {
      if (transfer->active) {
        static_cast<void>(libusb_cancel_transfer(transfer->transfer));
      }
    }
    if (!none_active()) {
      handle_events(rt::Clock::now() + kCancelTimeout, none_active);
    }
  }

  DeviceUrl url_;
  Context context_;
  Handle handle_;
  TransportIdentity identity_;
  std::vector<std::uint8_t> none_;
  BulkInterface interface_;
  bool claimed_ = false;
  std::array<Transfer, kInTransfers> in_;
  Transfer out_;
  Transfer control_;
  bool out_works_ = true;    ///< no OUT has failed
  std::uint64_t ended_ = 0;  ///< transfers so far, to keep their order
  TransportStatus status_ = TransportStatus::kOk;
  std::string failure_;
};

}  // namespace

std::unique_ptr<BulkTransport> open_libusb_transport(const DeviceUrl& url, std::uint16_t vendor_id,
                                                     std::uint16_t product_id) {
  return std::make_unique<LibusbTransport>(url, vendor_id, product_id);
}

}  // namespace forcegrid::driver
