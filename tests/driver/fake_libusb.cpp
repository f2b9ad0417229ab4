// SPDX-License-Identifier: Apache-2.0
#include "fake_libusb.h"

#include <libusb.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <set>
#include <thread>

using forcegrid::driver::ControlRequest;
using forcegrid::driver::FakeLibusb;

namespace {

struct Pending {
  libusb_transfer* transfer;
  bool cancelled;
};

std::unique_ptr<FakeLibusb> the_bus;
std::vector<Pending> pending;

bool is_in(const libusb_transfer* transfer) {
  return transfer->type == LIBUSB_TRANSFER_TYPE_BULK &&
         (transfer->endpoint & LIBUSB_ENDPOINT_IN) != 0;
}

}  // namespace

// The types that libusb keeps to itself.
struct libusb_context {};
struct libusb_device {
  std::size_t number;
};
struct libusb_device_handle {
  std::size_t number;
};

namespace {

// What the transport has not returned: a transfer that never ends, and its handle.
std::set<libusb_transfer*> live_transfers;
std::set<libusb_device_handle*> live_handles;

libusb_context the_context;
std::vector<libusb_device> device_list;

FakeLibusb::Device& device_of(const libusb_device_handle* handle) {
  return FakeLibusb::bus().devices.at(handle->number);
}

/// What becomes of a transfer now; LIBUSB_TRANSFER_TIMED_OUT stands for nothing yet.
libusb_transfer_status progress(Pending& entry) {
  libusb_transfer& transfer = *entry.transfer;
  FakeLibusb& bus = FakeLibusb::bus();
  auto& falcon = *device_of(transfer.dev_handle).falcon;
  if (entry.cancelled) {
    return bus.cancels ? LIBUSB_TRANSFER_CANCELLED : LIBUSB_TRANSFER_TIMED_OUT;
  }
  if (!falcon.plugged()) {
    return LIBUSB_TRANSFER_NO_DEVICE;
  }
  if (transfer.type == LIBUSB_TRANSFER_TYPE_CONTROL) {
    const unsigned char* setup = transfer.buffer;
    const ControlRequest request{.request_type = setup[0],
                                 .request = setup[1],
                                 .value = static_cast<std::uint16_t>(setup[2] | (setup[3] << 8)),
                                 .index = static_cast<std::uint16_t>(setup[4] | (setup[5] << 8))};
    if (!bus.answers_control) {
      return LIBUSB_TRANSFER_STALL;
    }
    return falcon.control(request) ? LIBUSB_TRANSFER_COMPLETED : LIBUSB_TRANSFER_STALL;
  }
  if (is_in(&transfer) ? bus.stalls_in : bus.stalls_out) {
    return LIBUSB_TRANSFER_STALL;
  }
  if (is_in(&transfer)) {
    const std::vector<std::uint8_t> packet = falcon.in();
    if (packet.size() > static_cast<std::size_t>(transfer.length)) {
      return LIBUSB_TRANSFER_OVERFLOW;
    }
    std::copy(packet.begin(), packet.end(), transfer.buffer);
    transfer.actual_length = static_cast<int>(packet.size());
    return LIBUSB_TRANSFER_COMPLETED;
  }
  if (!bus.takes_out) {
    return LIBUSB_TRANSFER_TIMED_OUT;
  }
  transfer.actual_length = transfer.length;
  return falcon.out({transfer.buffer, static_cast<std::size_t>(transfer.length)})
             ? LIBUSB_TRANSFER_COMPLETED
             : LIBUSB_TRANSFER_NO_DEVICE;
}

}  // namespace

namespace forcegrid::driver {

FakeLibusb& FakeLibusb::bus() { return *the_bus; }

void FakeLibusb::reset() {
  the_bus = std::make_unique<FakeLibusb>();
  pending.clear();
  for (libusb_transfer* transfer : live_transfers) {
    delete transfer;
  }
  for (libusb_device_handle* handle : live_handles) {
    delete handle;
  }
  live_transfers.clear();
  live_handles.clear();
}

}  // namespace forcegrid::driver

extern "C" {

int LIBUSB_CALL libusb_init(libusb_context** ctx) {
  ++FakeLibusb::bus().contexts;
  *ctx = &the_context;
  return 0;
}
void LIBUSB_CALL libusb_exit(libusb_context*) { --FakeLibusb::bus().contexts; }

const char* LIBUSB_CALL libusb_strerror(int errcode) {
  return errcode == LIBUSB_ERROR_ACCESS ? "Access denied (insufficient permissions)"
         : errcode == LIBUSB_ERROR_BUSY ? "Resource busy"
                                        : "Other error";
}
const char* LIBUSB_CALL libusb_error_name(int errcode) {
  return errcode == LIBUSB_ERROR_ACCESS ? "LIBUSB_ERROR_ACCESS"
         : errcode == LIBUSB_ERROR_BUSY ? "LIBUSB_ERROR_BUSY"
                                        : "LIBUSB_ERROR_OTHER";
}

ssize_t LIBUSB_CALL libusb_get_device_list(libusb_context*, libusb_device*** list) {
  const std::size_t count = FakeLibusb::bus().devices.size();
  device_list.clear();
  for (std::size_t i = 0; i < count; ++i) {
    device_list.push_back({i});
  }
  *list = new libusb_device*[count + 1];
  for (std::size_t i = 0; i < count; ++i) {
    (*list)[i] = &device_list[i];
  }
  (*list)[count] = nullptr;
  return static_cast<ssize_t>(count);
}
void LIBUSB_CALL libusb_free_device_list(libusb_device** list, int) { delete[] list; }

int LIBUSB_CALL libusb_get_device_descriptor(libusb_device* device,
                                             libusb_device_descriptor* descriptor) {
  const FakeLibusb::Device& fake = FakeLibusb::bus().devices.at(device->number);
  *descriptor = {};
  descriptor->idVendor = fake.vendor_id;
  descriptor->idProduct = fake.product_id;
  descriptor->iManufacturer = 1;
  descriptor->iProduct = 2;
  descriptor->iSerialNumber = 3;
  return 0;
}
std::uint8_t LIBUSB_CALL libusb_get_bus_number(libusb_device*) { return 1; }
// No real device of this computer has so high an address, so nobody is found to use its node.
std::uint8_t LIBUSB_CALL libusb_get_device_address(libusb_device*) { return 250; }
libusb_device* LIBUSB_CALL libusb_get_device(libusb_device_handle* handle) {
  return &device_list.at(handle->number);
}
int LIBUSB_CALL libusb_get_port_numbers(libusb_device* device, std::uint8_t* port_numbers, int) {
  const FakeLibusb::Device& fake = FakeLibusb::bus().devices.at(device->number);
  std::copy(fake.ports.begin(), fake.ports.end(), port_numbers);
  return static_cast<int>(fake.ports.size());
}

int LIBUSB_CALL libusb_open(libusb_device* device, libusb_device_handle** handle) {
  const int error = FakeLibusb::bus().devices.at(device->number).open_error;
  if (error == 0) {
    *handle = new libusb_device_handle{device->number};
    live_handles.insert(*handle);
    ++FakeLibusb::bus().handles;
  }
  return error;
}
void LIBUSB_CALL libusb_close(libusb_device_handle* handle) {
  if (handle != nullptr) {
    --FakeLibusb::bus().handles;
    live_handles.erase(handle);
    delete handle;
  }
}

int LIBUSB_CALL libusb_get_string_descriptor_ascii(libusb_device_handle* handle,
                                                   std::uint8_t desc_index, unsigned char* data,
                                                   int length) {
  const std::string text = desc_index == 1   ? "Novint"
                           : desc_index == 2 ? "FALCON HAPTIC"
                                             : device_of(handle).serial;
  const std::size_t size = std::min(text.size(), static_cast<std::size_t>(length));
  std::copy_n(text.begin(), size, data);
  return static_cast<int>(size);
}

int LIBUSB_CALL libusb_get_active_config_descriptor(libusb_device* device,
                                                    libusb_config_descriptor** configuration) {
  static const libusb_endpoint_descriptor endpoints[2] = {{.bLength = 7,
                                                           .bDescriptorType = 5,
                                                           .bEndpointAddress = 0x81,
                                                           .bmAttributes = 2,
                                                           .wMaxPacketSize = 64,
                                                           .bInterval = 0,
                                                           .bRefresh = 0,
                                                           .bSynchAddress = 0,
                                                           .extra = nullptr,
                                                           .extra_length = 0},
                                                          {.bLength = 7,
                                                           .bDescriptorType = 5,
                                                           .bEndpointAddress = 0x02,
                                                           .bmAttributes = 2,
                                                           .wMaxPacketSize = 64,
                                                           .bInterval = 0,
                                                           .bRefresh = 0,
                                                           .bSynchAddress = 0,
                                                           .extra = nullptr,
                                                           .extra_length = 0}};
  auto* const setting = new libusb_interface_descriptor{};
  setting->bNumEndpoints = 2;
  setting->bInterfaceClass = FakeLibusb::bus().devices.at(device->number).interface_class;
  setting->endpoint = endpoints;
  auto* const interface = new libusb_interface{.altsetting = setting, .num_altsetting = 1};
  *configuration = new libusb_config_descriptor{};
  (*configuration)->bNumInterfaces = 1;
  (*configuration)->interface = interface;
  return 0;
}
void LIBUSB_CALL libusb_free_config_descriptor(libusb_config_descriptor* configuration) {
  delete configuration->interface->altsetting;
  delete configuration->interface;
  delete configuration;
}

int LIBUSB_CALL libusb_set_auto_detach_kernel_driver(libusb_device_handle*, int enable) {
  FakeLibusb::bus().auto_detach = enable != 0;
  return 0;
}
int LIBUSB_CALL libusb_claim_interface(libusb_device_handle* handle, int) {
  const int error = device_of(handle).claim_error;
  FakeLibusb::bus().claimed += error == 0 ? 1 : 0;
  return error;
}
int LIBUSB_CALL libusb_release_interface(libusb_device_handle*, int) {
  --FakeLibusb::bus().claimed;
  return 0;
}

libusb_transfer* LIBUSB_CALL libusb_alloc_transfer(int) {
  ++FakeLibusb::bus().allocated;
  auto* const transfer = new libusb_transfer{};
  live_transfers.insert(transfer);
  return transfer;
}
void LIBUSB_CALL libusb_free_transfer(libusb_transfer* transfer) {
  FakeLibusb& bus = FakeLibusb::bus();
  ++bus.freed;
  bus.freed_in_use += std::any_of(pending.begin(), pending.end(),
                                  [&](const Pending& entry) { return entry.transfer == transfer; });
  live_transfers.erase(transfer);
  delete transfer;
}

int LIBUSB_CALL libusb_submit_transfer(libusb_transfer* transfer) {
  FakeLibusb& bus = FakeLibusb::bus();
  if (bus.submit_error != 0) {
    return bus.submit_error;
  }
  ++bus.submitted;
  pending.push_back({transfer, false});
  bus.most_pending_in = std::max(
      bus.most_pending_in,
      static_cast<int>(std::count_if(pending.begin(), pending.end(),
                                     [](const Pending& entry) { return is_in(entry.transfer); })));
  return 0;
}

int LIBUSB_CALL libusb_cancel_transfer(libusb_transfer* transfer) {
  for (Pending& entry : pending) {
    if (entry.transfer == transfer) {
      entry.cancelled = true;
      return 0;
    }
  }
  return LIBUSB_ERROR_NOT_FOUND;
}

int LIBUSB_CALL libusb_handle_events_timeout_completed(libusb_context*, timeval* tv, int*) {
  if (FakeLibusb::bus().events_error != 0) {
    return FakeLibusb::bus().events_error;
  }
  bool any = false;
  bool in_served = false;
  for (std::size_t i = 0; i < pending.size();) {
    // One IN token a frame, as the chip's latency timer has it.
    if (is_in(pending[i].transfer) && !pending[i].cancelled && in_served) {
      ++i;
      continue;
    }
    const bool was_in = is_in(pending[i].transfer);
    const libusb_transfer_status status = progress(pending[i]);
    if (status == LIBUSB_TRANSFER_TIMED_OUT) {
      ++i;
      continue;
    }
    in_served = in_served || was_in;
    any = true;
    libusb_transfer* const transfer = pending[i].transfer;
    pending.erase(pending.begin() + static_cast<std::ptrdiff_t>(i));
    transfer->status = status;
    transfer->callback(transfer);
  }
  if (in_served || !any) {
    const auto left = std::chrono::seconds(tv->tv_sec) + std::chrono::microseconds(tv->tv_usec);
    std::this_thread::sleep_for(
        std::min<std::chrono::nanoseconds>(left, std::chrono::milliseconds(1)));
  }
  return 0;
}

}  // extern "C"
