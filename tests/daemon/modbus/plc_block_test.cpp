// Where the values lie in the PLC, and what is refused before anything is written.
#include "daemon/modbus/plc_block.h"

#include <bit>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/modbus/snapshots.h"

namespace granary {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::vector<std::uint16_t> Encoded(const PlcBlock& block, const BinSnapshot& snapshot, ByteOrder order) {
  return EncodePlcBlock(block, {snapshot, test::kMeasuredAt + std::chrono::seconds{90}, test::kIdentity, {}}, order);
}

/// Fields of more registers than one write takes: sequence first, its check in the middle, 2 registers each otherwise.
std::vector<std::string> ManyFields() {
  std::vector<std::string> fields{"sequence"};
  for (int i = 0; i < 70; ++i) fields.emplace_back("volume");
  fields.emplace_back("sequence_check");
  for (int i = 0; i < 50; ++i) fields.emplace_back("quantity");
  for (int i = 0; i < 50; ++i) fields.emplace_back("density");
  return fields;
}

TEST(LayOutPlcBlock, WithoutFieldsIsTheSummaryInOneWrite) {
  const PlcBlock block = LayOutPlcBlock({});
  EXPECT_EQ(block.words, 65);
  EXPECT_THAT(block.writes, ElementsAre(PlcWrite{0, 65}));
  EXPECT_EQ(NameInPlcBlock(block, 64), "sequence_check");
}

TEST(LayOutPlcBlock, FieldsFollowEachOther) {
  const PlcBlock block = LayOutPlcBlock({"status", "volume", "sequence"});
  EXPECT_EQ(block.words, 4);
  EXPECT_EQ(NameInPlcBlock(block, 0), "status");
  EXPECT_EQ(NameInPlcBlock(block, 2), "volume");
  EXPECT_EQ(NameInPlcBlock(block, 3), "sequence");
}

TEST(LayOutPlcBlock, SequenceCheckGoesLast) {
  const PlcBlock block = LayOutPlcBlock(ManyFields());
  ASSERT_EQ(block.words, 342);
  // 123 would split a volume; the part with the check is the second.
  EXPECT_THAT(block.writes, ElementsAre(PlcWrite{0, 123}, PlcWrite{246, 96}, PlcWrite{123, 123}));
}

TEST(LayOutPlcBlock, SplitsNoValue) {
  const PlcBlock block = LayOutPlcBlock(std::vector<std::string>(62, "volume"));
  EXPECT_THAT(block.writes, ElementsAre(PlcWrite{0, 122}, PlcWrite{122, 2}));
}

TEST(LayOutPlcBlock, UnknownFieldThrows) {
  EXPECT_THROW(static_cast<void>(LayOutPlcBlock({"volum"})), std::invalid_argument);
}

TEST(EncodePlcBlock, SummaryIsAsTheServerHasIt) {
  const RegisterImage served = test::Encode(test::GoodSnapshot());
  const auto words = Encoded(LayOutPlcBlock({}), test::GoodSnapshot(), ByteOrder::kAbcd);
  EXPECT_THAT(words, ::testing::ElementsAreArray(served.data(), 65));
}

TEST(EncodePlcBlock, ByteOrderIsThePlcsOwn) {
  BinSnapshot snapshot = test::GoodSnapshot();
  snapshot.format.byte_order = ByteOrder::kBadc;  // what the server's clients wanted
  const PlcBlock block = LayOutPlcBlock({"volume", "sequence"});
  // 19.5 is 0x419C0000.
  EXPECT_THAT(Encoded(block, snapshot, ByteOrder::kAbcd), ElementsAre(0x419C, 0x0000, 17));
  EXPECT_THAT(Encoded(block, snapshot, ByteOrder::kCdab), ElementsAre(0x0000, 0x419C, 17));
  EXPECT_THAT(Encoded(block, snapshot, ByteOrder::kDcba), ElementsAre(0x0000, 0x9C41, 17));
  EXPECT_THAT(Encoded(block, snapshot, ByteOrder::kBadc), ElementsAre(0x9C41, 0x0000, 17));
}

TEST(EncodePlcBlock, InvalidPolicyIsTheSnapshots) {
  BinSnapshot snapshot = test::HeldSnapshot(Reason::kFrameMissing);
  snapshot.format.invalid = InvalidPolicy::kMinus9999;
  const auto words = Encoded(LayOutPlcBlock({"volume"}), snapshot, ByteOrder::kAbcd);
  EXPECT_EQ(std::bit_cast<float>(test::U32At(words.data())), -9999.0F);
}

TEST(LayOutPlcBlock, ManualHasTheWholeSummary) {
  std::ifstream file(GRANARY_DOCS_DIR "/modbus-plc.md");
  const std::string manual{std::istreambuf_iterator<char>(file), {}};
  for (const auto& field : LayOutPlcBlock({}).fields) {
    const RegisterRow& row = *field.row;
    const std::string unit = row.unit.empty() ? "" : " " + std::string(row.unit);
    EXPECT_THAT(manual, HasSubstr("| " + std::to_string(field.offset) + " | " + std::string(NameOf(row.type)) + " | `" +
                                  std::string(row.name) + "` |" + unit + " | "));
  }
}

ModbusPlcOptions Plc() {
  ModbusPlcOptions options;
  options.address = "192.168.7.20:502";
  return options;
}

TEST(PlcFaults, DefaultsAreWell) { EXPECT_THAT(PlcFaults(Plc(), 3), IsEmpty()); }

TEST(PlcFaults, UnknownFieldsAreNamedWithTheAllowedOnes) {
  auto options = Plc();
  options.fields = {"status", "volum", "masss"};
  EXPECT_THAT(PlcFaults(options, 1),
              ElementsAre(::testing::AllOf(HasSubstr("fields: no register is called \"volum\", \"masss\""),
                                           HasSubstr("status, namur_class"), HasSubstr("sequence_check"))));
}

TEST(PlcFaults, FieldThatNoWriteTakesIsUnknown) {
  for (const auto& row : RegisterTable()) {
    auto options = Plc();
    options.fields = {std::string(row.name)};
    EXPECT_EQ(PlcFaults(options, 1).empty(), row.words <= 123) << row.name;
  }
}

TEST(PlcFaults, BlocksOfSeveralBinsMustNotOverlap) {
  auto options = Plc();
  options.stride = 64;
  EXPECT_THAT(PlcFaults(options, 2), ElementsAre(HasSubstr("stride: is 64")));
  EXPECT_THAT(PlcFaults(options, 1), IsEmpty());
  options.stride = 65;
  EXPECT_THAT(PlcFaults(options, 2), IsEmpty());
}

TEST(PlcFaults, BlocksMustFitBelow65536) {
  auto options = Plc();
  options.base = 65536 - 165;
  EXPECT_THAT(PlcFaults(options, 2), IsEmpty());
  ++options.base;
  EXPECT_THAT(PlcFaults(options, 2), ElementsAre(HasSubstr("base: 2 bins take 165 registers from there; must be 0 to "
                                                           "65371")));
}

TEST(PlcFaults, StrideThatNeverFitsIsNamed) {
  auto options = Plc();
  options.stride = 10000;
  EXPECT_THAT(PlcFaults(options, 8), ElementsAre(HasSubstr("stride: is 10000, and 8 bins")));
}

TEST(PlcFaults, BookDataMustFitBelow65536) {
  auto options = Plc();
  options.book_base = 65532;
  EXPECT_THAT(PlcFaults(options, 1), IsEmpty());
  EXPECT_THAT(PlcFaults(options, 2), ElementsAre(HasSubstr("book_base: 2 bins take 8 registers")));
}

TEST(PlcFaults, BookDataMustNotBeWhatIsWritten) {
  auto options = Plc();
  options.book_base = 164;  // the last register of the second bin's block
  EXPECT_THAT(PlcFaults(options, 2), ElementsAre(HasSubstr("registers 100 to 164; must lie outside")));
  options.book_base = 165;
  EXPECT_THAT(PlcFaults(options, 2), IsEmpty());
  options.book_base = 92;  // 92 to 99, between the blocks
  EXPECT_THAT(PlcFaults(options, 2), IsEmpty());
}

TEST(PlcFaults, UnitThatNobodySendsIsNamed) {
  auto options = Plc();
  options.unit = 248;
  EXPECT_THAT(PlcFaults(options, 1), ElementsAre(HasSubstr("unit: is 248; must be 0 to 247, or 255")));
}

}  // namespace
}  // namespace granary
