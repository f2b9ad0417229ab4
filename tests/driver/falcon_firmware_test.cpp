// SPDX-License-Identifier: Apache-2.0
#include "driver/falcon_firmware.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "driver/device.h"

namespace forcegrid::driver::falcon {
namespace {

using testing::AllOf;
using testing::HasSubstr;

using Image = std::vector<std::uint8_t>;

/// The sheet's second image: one block of two words.
Image with_a_block() {
  Image image = {0xAA, 0x08};
  image.resize(18, 0x00);
  for (const int byte : {0x3F, 0x00, 0x02, 0x80, 0x02, 0x00, 0x3F, 0x00, 0x00, 0x80, 0x34, 0x12,
                         0x78, 0x56, 0x00, 0x00}) {
    image.push_back(static_cast<std::uint8_t>(byte));
  }
  return image;
}

std::string refusal_of(const Image& image) {
  try {
    check_firmware(image, "some.bin");
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("firmware 'some.bin': byte "),
                                    HasSubstr("nothing was sent"), HasSubstr("--firmware FILE")));
    return error.what();
  }
  ADD_FAILURE() << "taken";
  return "";
}

TEST(FalconFirmware, TakesTheSheetsImages) {
  Image shortest = {0xAA, 0x08};
  shortest.resize(18, 0x00);
  for (const int byte : {0x3F, 0x00, 0x02, 0x80, 0x00, 0x00}) {
    shortest.push_back(static_cast<std::uint8_t>(byte));
  }
  EXPECT_EQ(synthetic_firmware().bytes, shortest);
  EXPECT_NO_THROW(check_firmware(shortest, "shortest"));
  EXPECT_EQ(with_a_block().size(), 34U);
  EXPECT_NO_THROW(check_firmware(with_a_block(), "with a block"));
}

TEST(FalconFirmware, RefusesAnotherKey) {
  Image image = with_a_block();
  image[0] = 0xAB;
  EXPECT_THAT(refusal_of(image), HasSubstr("byte 0: it does not begin with the key AA 08"));
}

TEST(FalconFirmware, RefusesAnythingInTheReservedWords) {
  Image image = with_a_block();
  image[13] = 0x01;
  EXPECT_THAT(refusal_of(image), HasSubstr("byte 12: a reserved word is not zero"));
}

TEST(FalconFirmware, RefusesAnEntryAddressOfZero) {
  Image image = with_a_block();
  image[18] = image[20] = image[21] = 0;
  EXPECT_THAT(refusal_of(image), HasSubstr("byte 18: the entry address is zero"));
}

TEST(FalconFirmware, RefusesEveryTruncation) {
  const Image whole = with_a_block();
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const Image image(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_THAT(refusal_of(image),
                testing::AnyOf(HasSubstr("the file ends where"), HasSubstr("bytes follow")))
        << size;
  }
}

TEST(FalconFirmware, RefusesABlockLargerThanTheFile) {
  Image image = with_a_block();
  image[22] = 0xFF;
  EXPECT_THAT(refusal_of(image),
              HasSubstr("byte 22: a block of 255 words begins, but only 6 bytes follow"));
}

TEST(FalconFirmware, RefusesTrailingBytes) {
  Image image = with_a_block();
  image.push_back(0x00);
  EXPECT_THAT(refusal_of(image), HasSubstr("byte 34: 1 bytes follow the end of the stream"));
}

TEST(FalconFirmware, SaysWhereOneGetsAFileThatIsMissing) {
  try {
    static_cast<void>(load_firmware("/nowhere/firmware.bin"));
    FAIL() << "loaded";
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(),
                AllOf(HasSubstr("firmware '/nowhere/firmware.bin': there is no such file"),
                      HasSubstr("libnifalcon"), HasSubstr("--firmware FILE")));
  }
}

class FirmwareFile : public testing::Test {
 protected:
  void TearDown() override { std::filesystem::remove(path_); }

  const std::string path_ = testing::TempDir() + "forcegrid_firmware_" +
                            std::to_string(::testing::UnitTest::GetInstance()->random_seed()) +
                            testing::UnitTest::GetInstance()->current_test_info()->name() + ".bin";
};

TEST_F(FirmwareFile, IsReadWhole) {
  const Image image = with_a_block();
  std::ofstream(path_, std::ios::binary)
      .write(reinterpret_cast<const char*>(image.data()),
             static_cast<std::streamsize>(image.size()));
  const Firmware firmware = load_firmware(path_);
  EXPECT_EQ(firmware.bytes, image);
  EXPECT_EQ(firmware.name, path_);
}

TEST_F(FirmwareFile, IsRefusedWhenItIsAFolder) {
  EXPECT_THROW(static_cast<void>(load_firmware(testing::TempDir())), DeviceError);
}

TEST_F(FirmwareFile, IsRefusedUnreadWhenItIsHuge) {
  std::ofstream(path_, std::ios::binary) << "x";
  std::filesystem::resize_file(path_, 64 << 20);
  try {
    static_cast<void>(load_firmware(path_));
    FAIL() << "loaded";
  } catch (const DeviceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("it has 67108864 bytes"));
  }
}

}  // namespace
}  // namespace forcegrid::driver::falcon
