// A line with one master, a neighbour, and all that goes wrong on such lines, in virtual time.
#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/modbus/rtu_listener.h"

namespace granary::test {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;
using testing::IsEmpty;

const Bytes kRequest = ReadRequest(kUs);

TEST(RtuFraming, GivesARequestWhenTheLineHasBeenSilent) {
  Listener line;
  line.Hear(kRequest).Wait(line.Timing().t35 - 1ns);
  EXPECT_THAT(line.Take(), IsEmpty());
  line.Wait(1ns);
  EXPECT_THAT(line.Take(), ElementsAre(kRequest));
}

TEST(RtuFraming, GivesNothingToWhoAsksTooEarly) {
  ModbusTally tally;
  RtuFraming framing(
      TimingOf(19200), [](std::uint8_t) { return true; }, tally);
  framing.Receive(kRequest, RtuFraming::Time(1s));
  EXPECT_FALSE(framing.Next(RtuFraming::Time(1s) + TimingOf(19200).t35 - 1ns));
  EXPECT_TRUE(framing.Next(RtuFraming::Time(1s) + TimingOf(19200).t35));
}

TEST(RtuFraming, WantsNothingWhileNothingIsHeard) {
  ModbusTally tally;
  const RtuFraming framing(
      TimingOf(9600), [](std::uint8_t) { return true; }, tally);
  EXPECT_FALSE(framing.Deadline());
}

TEST(RtuFraming, NeverTakesAnAddressBeyond247) {
  ModbusTally tally;
  RtuFraming framing(
      TimingOf(9600), [](std::uint8_t) { return true; }, tally);
  for (const int address : {248, 255}) {
    framing.Receive(ReadRequest(address), {});
    EXPECT_FALSE(framing.Next(RtuFraming::Time(1s)));
  }
  EXPECT_EQ(tally.rtu_errors, 2U);
}

TEST(RtuFraming, PassesOverANeighboursRequestAndReply) {
  Listener line;
  line.Hear(ReadRequest(kNeighbour)).Pause().Hear(ReadReply(kNeighbour, {1, 2})).Pause().Hear(kRequest).Pause();
  EXPECT_THAT(line.Take(), ElementsAre(kRequest));
  EXPECT_EQ(line.Counters().rtu_others, 2U);
  EXPECT_EQ(line.Counters().rtu_errors, 0U);
}

TEST(RtuFraming, FindsTheRequestAfterADeadNeighboursTimeOut) {
  Listener line;
  for (const auto time_out : {2100us, 50000us, 500000us}) {
    line.Hear(ReadRequest(kNeighbour)).Wait(time_out).Hear(kRequest).Pause();
    EXPECT_THAT(line.Take(), ElementsAre(kRequest));
  }
}

TEST(RtuFraming, FindsTheRequestJoinedToANeighboursReply) {
  Listener line;
  line.Hear(Joined({ReadReply(kNeighbour, {1, 2, 3, 4}), kRequest})).Pause();
  EXPECT_THAT(line.Take(), ElementsAre(kRequest));
  EXPECT_EQ(line.Counters().rtu_others, 1U);
}

TEST(RtuFraming, FindsTheRequestAtTheEndOfAWholeExchange) {
  Listener line;
  line.Hear(Joined({ReadRequest(kNeighbour), ReadReply(kNeighbour, Bytes(250, 0)), WriteRequest(kNeighbour),
                    WriteRequest(kNeighbour), ReadRequest(kNeighbour), RtuFrame(kNeighbour, Bytes{0x83, 2}), kRequest}))
      .Pause();
  EXPECT_THAT(line.Take(), ElementsAre(kRequest));
  EXPECT_EQ(line.Counters().rtu_others, 6U);
}

TEST(RtuFraming, FindsTheRequestBehindNoise) {
  for (const Bytes& noise : {Bytes{0x00}, Bytes{0xFF}, Bytes{0x55, 0xAA}, Bytes{0x00, 0x00, 0x00}, Bytes{kUs},
                             Bytes{kUs, 3}, Bytes{kNeighbour, 3, 200}, Bytes{kNeighbour, 65}}) {
    Listener line;
    line.Hear(Joined({noise, kRequest})).Wait(kLong);
    EXPECT_THAT(line.Take(), ElementsAre(kRequest)) << testing::PrintToString(noise);
    EXPECT_EQ(line.Counters().rtu_errors, 1U);
  }
}

TEST(RtuFraming, LetsASingleNoiseByteDelayNothing) {
  for (int noise = 0; noise < 256; ++noise) {
    Listener line;
    line.Hear(Joined({Bytes{static_cast<std::uint8_t>(noise)}, kRequest})).Pause();
    EXPECT_THAT(line.Take(), ElementsAre(kRequest)) << noise;
  }
}

TEST(RtuFraming, FindsTheRequestAfterHalfANeighboursReply) {
  const Bytes reply = ReadReply(kNeighbour, Bytes(40, 0x11));
  for (std::size_t cut = 1; cut < reply.size(); ++cut) {
    Listener line;
    line.Hear(Part(reply, 0, cut)).Wait(5ms).Hear(kRequest).Wait(kLong);
    EXPECT_THAT(line.Take(), ElementsAre(kRequest)) << cut;
    EXPECT_GE(line.Counters().rtu_errors, 1U);
  }
}

TEST(RtuFraming, FindsTheRequestRightBehindADamagedReply) {
  Bytes damaged = ReadReply(kNeighbour, Bytes(60, 0));
  damaged[20] ^= 0x10;
  Listener line;
  line.Hear(Joined({damaged, kRequest})).Pause();
  EXPECT_THAT(line.Take(), ElementsAre(kRequest));
}

TEST(RtuFraming, LetsADamagedReplyDelayNothing) {
  // Near its end its data look like the beginning of something long.
  Bytes damaged = ReadReply(kNeighbour, Joined({Bytes(20, 0), Bytes{9, 3, 200, 1}}));
  damaged[10] ^= 0x10;
  Listener line;
  line.Hear(Joined({damaged, kRequest})).Pause();
  EXPECT_THAT(line.Take(), ElementsAre(kRequest));
}

TEST(RtuFraming, FindsTheRepeatedRequestAfterHalfOfOne) {
  for (std::size_t cut = 1; cut < kRequest.size(); ++cut) {
    Listener line;
    line.Hear(Part(kRequest, 0, cut)).Wait(100ms).Hear(kRequest).Pause();
    EXPECT_THAT(line.Take(), ElementsAre(kRequest)) << cut;
    EXPECT_EQ(line.Counters().rtu_errors, 1U);
  }
}

TEST(RtuFraming, PutsAFrameTogetherThatAnAdapterTears) {
  const Bytes write = RtuFrame(kUs, Bytes{16, 0x03, 0x98, 0, 2, 4, 1, 2, 3, 4});
  for (const auto gap : {1800us, 5000us, 16000us}) {
    for (std::size_t cut = 1; cut < write.size(); ++cut) {
      Listener line;
      line.Hear(Part(write, 0, cut)).Wait(gap).Hear(Part(write, cut, write.size())).Pause();
      EXPECT_THAT(line.Take(), ElementsAre(write)) << cut;
      EXPECT_EQ(line.Counters().rtu_errors, 0U);
    }
  }
}

TEST(RtuFraming, PutsAFrameTogetherThatComesByteByByte) {
  Listener line;
  for (const std::uint8_t byte : kRequest) line.Hear({byte}).Wait(3ms);
  EXPECT_THAT(line.Take(), ElementsAre(kRequest));
}

TEST(RtuFraming, TakesNoWrongChecksum) {
  for (std::size_t byte = 0; byte < kRequest.size(); ++byte) {
    for (int bit = 0; bit < 8; ++bit) {
      Bytes damaged = kRequest;
      damaged[byte] ^= static_cast<std::uint8_t>(1 << bit);
      Listener line;
      line.Hear(damaged).Wait(kLong);
      EXPECT_THAT(line.Take(), IsEmpty());
      EXPECT_EQ(line.Counters().rtu_errors, 1U);
    }
  }
}

TEST(RtuFraming, TakesNoLengthThatDoesNotFitTheFunction) {
  Listener line;
  for (const Bytes& pdu : {Bytes{3, 0, 0, 0}, Bytes{3, 0, 0, 0, 1, 0}, Bytes{6, 0, 0, 0, 1, 0}, Bytes{22, 0, 0, 0, 1},
                           Bytes{16, 0, 0, 0, 1, 2, 0}, Bytes{17, 0}, Bytes{43, 14, 1}, Bytes{3}}) {
    line.Hear(RtuFrame(kUs, pdu)).Wait(kLong);
  }
  EXPECT_THAT(line.Take(), IsEmpty());
  EXPECT_EQ(line.Counters().rtu_errors, 8U);
}

TEST(RtuFraming, TakesARequestOfAnUnknownFunctionThatFillsItsRoom) {
  const Bytes request = RtuFrame(kUs, Bytes{65, 1, 2, 3});
  Listener line;
  line.Hear(request).Pause();
  EXPECT_THAT(line.Take(), ElementsAre(request));
}

TEST(RtuFraming, TakesNothingThatOnlyAReplyCanBe) {
  Listener line;
  line.Hear(RtuFrame(kUs, Bytes{0x83, 2})).Wait(kLong).Hear(ReadReply(kUs, {1, 2})).Wait(kLong);
  EXPECT_THAT(line.Take(), IsEmpty());
}

TEST(RtuFraming, TakesNoRequestOutOfANeighboursData) {
  const Bytes reply = ReadReply(kNeighbour, Joined({Bytes{1, 2}, kRequest, Bytes{3, 4}}));
  Listener line;
  line.Hear(reply).Wait(kLong).Hear(Joined({ReadRequest(kNeighbour), reply})).Wait(kLong);
  EXPECT_THAT(line.Take(), IsEmpty());
  EXPECT_EQ(line.Counters().rtu_others, 3U);
}

TEST(RtuFraming, TakesNoRequestOutOfANeighboursTornData) {
  const Bytes reply = ReadReply(kNeighbour, Joined({Bytes{1, 2}, kRequest, Bytes{3, 4}}));
  for (std::size_t cut = 1; cut < reply.size(); ++cut) {
    Listener line;
    line.Hear(Part(reply, 0, cut)).Wait(10ms).Hear(Part(reply, cut, reply.size())).Wait(kLong);
    EXPECT_THAT(line.Take(), IsEmpty()) << cut;
    EXPECT_EQ(line.Counters().rtu_others, 1U);
  }
}

TEST(RtuFraming, TakesNoRequestOutOfANeighboursDamagedData) {
  const Bytes reply = ReadReply(kNeighbour, Joined({Bytes{1, 2}, kRequest}));
  for (std::size_t byte = 0; byte < 5; ++byte) {
    Bytes damaged = reply;
    damaged[byte] ^= 0x40;
    Listener line;
    line.Hear(damaged).Wait(kLong);
    EXPECT_THAT(line.Take(), IsEmpty()) << byte;
  }
}

TEST(RtuFraming, TakesNoRequestOutOfANeighboursUnknownFunction) {
  Bytes pdu{65, 1, 2};
  pdu.insert(pdu.end(), kRequest.begin(), kRequest.end());
  Listener line;
  line.Hear(RtuFrame(kNeighbour, pdu)).Wait(kLong);
  EXPECT_THAT(line.Take(), IsEmpty());
  EXPECT_EQ(line.Counters().rtu_others, 1U);
}

TEST(RtuFraming, PassesOverANeighboursIdentification) {
  Listener line;
  line.Hear(Joined({RtuFrame(kNeighbour, Bytes{43, 14, 1, 0}),
                    RtuFrame(kNeighbour, Bytes{43, 14, 1, 1, 0, 0, 1, 0, 3, 'a', 'b', 'c'}), kRequest}))
      .Pause();
  EXPECT_THAT(line.Take(), ElementsAre(kRequest));
  EXPECT_EQ(line.Counters().rtu_others, 2U);
}

TEST(RtuFraming, PassesOverATornFrameOfAnUnknownFunction) {
  const Bytes unknown = RtuFrame(kNeighbour, Bytes{100, 1, 2, 3, 4, 5});
  Listener line;
  line.Hear(Part(unknown, 0, 4)).Wait(10ms).Hear(Part(unknown, 4, unknown.size())).Wait(kLong);
  EXPECT_EQ(line.Counters().rtu_others, 1U);
  EXPECT_EQ(line.Counters().rtu_errors, 0U);
}

TEST(RtuFraming, PassesOverFramesOfUnknownFunctionsBetweenPauses) {
  ModbusTally tally;
  const RtuTiming timing = TimingOf(19200);
  RtuFraming framing(
      timing, [](std::uint8_t address) { return address == kUs; }, tally);
  RtuFraming::Time now(1s);
  // Read in time, but the program was too busy to look at them in between.
  for (const Bytes& frame : {RtuFrame(kNeighbour, Bytes{100, 9, 9}), RtuFrame(kNeighbour, Bytes{100, 8}), kRequest}) {
    now += timing.character * static_cast<int>(frame.size()) + timing.t35;
    framing.Receive(frame, now);
  }
  EXPECT_TRUE(framing.Next(now + timing.t35));
  EXPECT_EQ(tally.rtu_others, 2U);
  EXPECT_EQ(tally.rtu_errors, 0U);
}

TEST(RtuFraming, RemembersAPauseWhileTheRestIsStillToCome) {
  ModbusTally tally;
  const RtuTiming timing = TimingOf(19200);
  RtuFraming framing(
      timing, [](std::uint8_t address) { return address == kUs; }, tally);
  const Bytes unknown = RtuFrame(kNeighbour, Bytes{100, 1, 2, 3, 4, 5});
  RtuFraming::Time now(1s);
  framing.Receive(Joined({ReadRequest(kNeighbour), Bytes{kNeighbour, 100, 1}}), now);
  framing.Receive(Part(unknown, 0, 4), now += 5ms);
  EXPECT_FALSE(framing.Next(now + timing.t35));  // the frame of a neighbour is taken off, the rest waits
  framing.Receive(Part(unknown, 4, unknown.size()), now += 5ms);
  EXPECT_FALSE(framing.Next(now + kLong));
  EXPECT_EQ(tally.rtu_others, 2U);
  EXPECT_EQ(tally.rtu_errors, 1U);
}

TEST(RtuFraming, LeavesARequestThatTheMasterHasGivenUp) {
  Listener line;
  line.Hear(Joined({WriteRequest(kUs), ReadRequest(kNeighbour)})).Wait(kLong);
  EXPECT_THAT(line.Take(), IsEmpty());
  EXPECT_EQ(line.Counters().rtu_errors, 1U);
  line.Hear(Joined({WriteRequest(kUs), kRequest})).Wait(kLong);
  EXPECT_THAT(line.Take(), ElementsAre(kRequest));
}

TEST(RtuFraming, ForgivesTheClickOfATransceiverAfterTheRequest) {
  for (const Bytes& click : {Bytes{0}, Bytes{0xFF}, Bytes{0xFE, 0xFF}, Bytes{kUs, 3, 0}}) {
    Listener line;
    line.Hear(Joined({kRequest, click})).Pause();
    EXPECT_THAT(line.Take(), ElementsAre(kRequest));
    EXPECT_EQ(line.Counters().rtu_errors, 1U);
  }
}

TEST(RtuFraming, GivesBroadcasts) {
  Listener line;
  line.Hear(WriteRequest(0)).Pause();
  EXPECT_THAT(line.Take(), ElementsAre(WriteRequest(0)));
  line.Hear(Joined({WriteRequest(0), kRequest})).Pause();
  EXPECT_THAT(line.Take(), ElementsAre(WriteRequest(0), kRequest));
}

TEST(RtuFraming, TakesNoBroadcastOutOfNoise) {
  Listener line;
  line.Hear(Joined({Bytes{0x55, 0xAA, 0x00}, WriteRequest(0)})).Wait(kLong);
  EXPECT_THAT(line.Take(), IsEmpty());
}

TEST(RtuFraming, SurvivesNoiseWithoutEnd) {
  Listener line(115200);
  for (int i = 0; i < 20'000; ++i) line.Hear(Bytes(10, static_cast<std::uint8_t>(i)));  // never t3.5 apart
  EXPECT_GE(line.Counters().rtu_errors, 1U);  // what came first is gone, nothing grows without end
  line.Wait(kLong).Hear(kRequest).Pause();
  EXPECT_THAT(line.Take(), ElementsAre(kRequest));
}

// What we send is heard again on two wires, unless the transceiver or the driver shuts the receiver off meanwhile.

TEST(RtuFraming, KnowsItsOwnAnswer) {
  const Bytes answer = ReadReply(kUs, {1, 2});
  Listener line;
  line.Hear(kRequest).Pause().Send(answer).Hear(answer).Pause().Hear(kRequest).Pause();
  EXPECT_THAT(line.Take(), ElementsAre(kRequest, kRequest));
  EXPECT_EQ(line.Counters().rtu_errors, 0U);
  EXPECT_EQ(line.Counters().rtu_others, 0U);
}

TEST(RtuFraming, KnowsItsOwnAnswerJoinedToTheNextRequest) {
  const Bytes answer = ReadReply(kUs, {1, 2});
  Listener line;
  line.Send(answer).Hear(Joined({answer, kRequest})).Pause();
  EXPECT_THAT(line.Take(), ElementsAre(kRequest));
}

TEST(RtuFraming, KnowsItsOwnAnswerInPieces) {
  const Bytes answer = ReadReply(kUs, Bytes(100, 7));
  Listener line;
  line.Send(answer);
  for (std::size_t i = 0; i < answer.size(); i += 35) {
    line.Hear(Part(answer, i, std::min(i + 35, answer.size()))).Wait(16ms);
  }
  line.Hear(kRequest).Pause();
  EXPECT_THAT(line.Take(), ElementsAre(kRequest));
  EXPECT_EQ(line.Counters().rtu_errors, 0U);
}

TEST(RtuFraming, TakesTheEchoOfAWriteForNoRequest) {
  const Bytes write = WriteRequest(kUs);  // whose answer is equal
  Listener line;
  line.Hear(write).Pause().Send(write).Hear(write).Wait(kLong);
  EXPECT_THAT(line.Take(), ElementsAre(write));
}

TEST(RtuFraming, TakesTheEchoOfAWriteForNoRequestBehindNoise) {
  const Bytes write = WriteRequest(kUs);
  Listener line;
  line.Hear(write).Pause().Send(write).Hear(Joined({Bytes{0x00}, write})).Wait(kLong);
  EXPECT_THAT(line.Take(), ElementsAre(write));
}

TEST(RtuFraming, TakesALateEchoOfAWriteForNoRequestOnceOneWasHeard) {
  const Bytes answer = ReadReply(kUs, {1, 2}), write = WriteRequest(kUs);
  Listener line;
  line.Send(answer).Hear(answer).Pause().Hear(write).Pause().Send(write).Wait(200ms).Hear(write).Wait(kLong);
  EXPECT_THAT(line.Take(), ElementsAre(write));
}

TEST(RtuFraming, DoesNotConcludeFromADamagedEchoThatThereIsNone) {
  const Bytes answer = ReadReply(kUs, {1, 2}), write = WriteRequest(kUs);
  Bytes damaged = answer;
  damaged[4] ^= 1;
  Listener line;
  line.Send(answer).Hear(damaged).Wait(kLong).Hear(write).Pause().Send(write).Hear(write).Wait(kLong);
  EXPECT_THAT(line.Take(), ElementsAre(write));
}

TEST(RtuFraming, TakesAWriteThatComesAgain) {
  const Bytes write = WriteRequest(kUs);
  Listener line;
  line.Hear(write).Pause().Send(write).Wait(kLong).Hear(write).Pause();
  EXPECT_THAT(line.Take(), ElementsAre(write, write));
}

TEST(RtuFraming, TakesAWriteThatComesAgainAtOnceWhereNoEchoIs) {
  const Bytes write = WriteRequest(kUs);
  Listener line;
  line.Hear(kRequest).Pause().Send(ReadReply(kUs, {1, 2})).Pause();
  for (int i = 0; i < 3; ++i) line.Hear(write).Pause().Send(write).Pause();
  EXPECT_THAT(line.Take(), ElementsAre(kRequest, write, write, write));
}

}  // namespace
}  // namespace granary::test
