// Which of the PLC's book data are taken for news.
#include "daemon/modbus/plc_book.h"

#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace granary {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

Inventory InForce() {
  Inventory inventory;
  inventory.book_mass_kg = 15200;
  inventory.density_kg_m3 = 790.1;
  inventory.correction = 1.02;
  inventory.loss_kg = 12;
  return inventory;
}

TEST(DecodePlcBook, TakesEveryByteOrder) {
  // 15.25 is 0x41740000, 790.5 is 0x4445A000.
  const PlcBook book{15.25F, 790.5F};
  EXPECT_EQ(DecodePlcBook(std::array<std::uint16_t, 4>{0x4174, 0x0000, 0x4445, 0xA000}, ByteOrder::kAbcd), book);
  EXPECT_EQ(DecodePlcBook(std::array<std::uint16_t, 4>{0x0000, 0x4174, 0xA000, 0x4445}, ByteOrder::kCdab), book);
  EXPECT_EQ(DecodePlcBook(std::array<std::uint16_t, 4>{0x0000, 0x7441, 0x00A0, 0x4544}, ByteOrder::kDcba), book);
  EXPECT_EQ(DecodePlcBook(std::array<std::uint16_t, 4>{0x7441, 0x0000, 0x4544, 0x00A0}, ByteOrder::kBadc), book);
}

TEST(DecodePlcBook, AnotherNumberOfRegistersThrows) {
  EXPECT_THROW(static_cast<void>(DecodePlcBook(std::vector<std::uint16_t>(3), ByteOrder::kAbcd)),
               std::invalid_argument);
}

TEST(JudgePlcBook, RoundingToFloatIsNoNews) {
  EXPECT_EQ(JudgePlcBook({15.2F, 790.1F}, InForce()).finding, PlcBookFinding::kInForce);
}

TEST(JudgePlcBook, OneMoreRoundingInThePlcIsNoNews) {
  EXPECT_EQ(JudgePlcBook({std::nextafter(15.2F, 16.0F), 790.1F}, InForce()).finding, PlcBookFinding::kInForce);
}

TEST(JudgePlcBook, CommittedFigureIsInForceAfterwards) {
  const auto verdict = JudgePlcBook({15.3F, 791.7F}, InForce());
  ASSERT_EQ(verdict.finding, PlcBookFinding::kNew);
  EXPECT_EQ(JudgePlcBook({15.3F, 791.7F}, WithBook(InForce(), verdict.book)).finding, PlcBookFinding::kInForce);
}

TEST(JudgePlcBook, NewQuantityKeepsCorrectionAndLoss) {
  const auto verdict = JudgePlcBook({15.5F, 790.1F}, InForce());
  EXPECT_EQ(verdict.finding, PlcBookFinding::kNew);
  EXPECT_DOUBLE_EQ(verdict.book.book_mass_kg, 15500);
  EXPECT_EQ(verdict.book.density_kg_m3, static_cast<double>(790.1F));
  EXPECT_EQ(verdict.book.correction, 1.02);
  EXPECT_EQ(verdict.book.loss_kg, 12);
}

TEST(JudgePlcBook, FirstBookDataAreNew) {
  EXPECT_EQ(JudgePlcBook({15.2F, 790.1F}, Inventory{}).finding, PlcBookFinding::kNew);
}

TEST(JudgePlcBook, ZeroForBothIsNoData) { EXPECT_EQ(JudgePlcBook({0, 0}, InForce()).finding, PlcBookFinding::kNoData); }

TEST(JudgePlcBook, NanForBothIsNoData) {
  EXPECT_EQ(JudgePlcBook({kNan, kNan}, InForce()).finding, PlcBookFinding::kNoData);
}

TEST(JudgePlcBook, EmptyBinIsNews) { EXPECT_EQ(JudgePlcBook({0, 790.1F}, InForce()).finding, PlcBookFinding::kNew); }

TEST(JudgePlcBook, NanForOneIsRefused) {
  EXPECT_EQ(JudgePlcBook({kNan, 790.1F}, InForce()).finding, PlcBookFinding::kRefused);
}

TEST(JudgePlcBook, OutOfRangeIsRefusedByName) {
  const auto verdict = JudgePlcBook({15.2F, 79000.0F}, InForce());
  EXPECT_EQ(verdict.finding, PlcBookFinding::kRefused);
  EXPECT_THAT(verdict.faults, ::testing::ElementsAre(::testing::HasSubstr("density_kg_m3")));
}

}  // namespace
}  // namespace granary
